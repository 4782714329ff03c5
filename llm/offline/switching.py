"""Words of switching: "turn the oven on", "switch off the lamp", "press the button of the microwave", "turn its knob".

They are verbs only where a scene has something with a button or a knob. Elsewhere the words stay what they are, and
the refusal says that no joint of that kind is there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from llm.offline.intents import ControlPart, Intent, IntentKind, Refusal, Surroundings, alternatives
from llm.offline.words import ENDS, TaggedWord

_SWITCHING = frozenset({"turn", "switch", "power", "flip", "toggle", "click"})
"""Verbs that say with "on" or "off" what shall be."""

_OPERATING = frozenset(
    {"press", "push", "push in", "hit", "tap", "turn", "twist", "rotate", "toggle", "flip", "switch", "operate"}
)
"""Verbs for a button or a knob, whichever way it is."""

PART_OF: Mapping[str, ControlPart] = MappingProxyType(
    {"button": "button", "push button": "button", "knob": "knob", "dial": "knob"}
)
_EITHER = frozenset({"switch", "control"})
_WAYS = ("on", "off")
_ARTICLES = frozenset({"DETERMINER", "A"})
_LINKS = frozenset({"OF", "ON", "TO", "FROM", "IN"})
_SIDED = {"ONLEFT": "LEFT", "ONRIGHT": "RIGHT"}


def with_switchings(tokens: Sequence[TaggedWord], around: Surroundings) -> tuple[TaggedWord, ...]:
    """Return a query's words with those of switching tagged as such; as they are where nothing can be switched.

    "The button of the oven" becomes the oven, since a thing has one button or knob.

    Raises:
        Refusal: "The button" alone is that of several things, or of none.
    """
    if not any(around.control(key) for key in around.scene.objects):
        return tuple(tokens)
    words, found = list(tokens), list[TaggedWord]()
    while words:
        opens = not found or found[-1].terminal in ENDS
        clause = _clause(words) if opens and words[0].text in _SWITCHING | _OPERATING else []
        switched = _switched(clause, around) if clause else None
        if switched is None:
            found.append(words.pop(0))
        else:
            found += switched
            del words[: len(clause)]
    return tuple(found)


def switchings(ids: Sequence[str], way: str, part: str, around: Surroundings) -> tuple[Intent, ...]:
    """Return the intents of switching things.

    Args:
        ids: The things.
        way: "switch_on", "switch_off", or "operate", which switches each to what it is not.
        part: "button" or "knob", where the sentence names it.

    Raises:
        Refusal: One of them has no such part.
    """
    for key in ids:
        control = around.control(key)
        if control is None or part not in ("", control):
            has = "neither a button nor a knob" if control is None else f"a {control} and no {part}"
            known = [one for one in around.scene.objects if around.control(one) is not None]
            shown, instead = list(map(around.described, known)), [switching_of(one, around) for one in known]
            raise Refusal("affordance", f"{key} has {has}", scene=shown, instead=instead)
    kinds = {"switch_on": IntentKind.SWITCH_ON, "switch_off": IntentKind.SWITCH_OFF}
    return tuple(Intent(kinds[way], key) if way in kinds else switching_of(key, around) for key in ids)


def switching_of(key: str, around: Surroundings) -> Intent:
    """Return the intent of switching a thing to what it is not."""
    return Intent(IntentKind.SWITCH_OFF if around.is_on(key) else IntentKind.SWITCH_ON, key)


def _clause(words: Sequence[TaggedWord]) -> list[TaggedWord]:
    """Return the words up to the end of a wish, "on" or "off" after a list of things included."""
    ends = [*(index for index, word in enumerate(words) if word.terminal in ENDS), len(words)]
    if words[1:] and words[1].text not in _WAYS:
        for end in ends:
            if words[end - 1].text in _WAYS:
                return list(words[:end])
            if words[end:] and (words[end].terminal not in ("AND", "COMMA") or not _goes_on(words[end + 1 :])):
                break
    return list(words[: ends[0]])


def _goes_on(words: Sequence[TaggedWord]) -> bool:
    """Decide whether words begin with another thing: "the lamp" in "turn the oven and the lamp on"."""
    return bool(words) and words[0].terminal in (*_ARTICLES, "WORD") and words[0].text not in _SWITCHING | _OPERATING


def _switched(clause: list[TaggedWord], around: Surroundings) -> list[TaggedWord] | None:
    """Return the words of a wish to switch something; None for another wish."""
    verb, *rest = clause
    way = ""
    if verb.text in _SWITCHING and rest and rest[0].terminal in _SIDED:
        # "Turn on the left lamp".
        rest = [TaggedWord("DETERMINER", "the"), TaggedWord(_SIDED[rest[0].terminal], "left"), *rest[1:]]
        return [TaggedWord("SWITCHON", "switch on"), *rest]
    if verb.text in _SWITCHING and len(rest) > 1 and rest[0].text in _WAYS:
        way, (rest, part) = rest[0].text, _without_part(rest[1:], around)
        return [TaggedWord("SWITCHON" if way == "on" else "SWITCHOFF", part or f"switch {way}"), *rest]
    if verb.text in _SWITCHING and len(rest) > 1 and rest[-1].text in _WAYS:
        way, rest = rest[-1].text, rest[:-1]
    elif verb.text not in _OPERATING:
        return None
    rest, part = _without_part(rest, around)
    if not part and not way and (verb.terminal != "WORD" or not rest):
        # "Switch the mug and the cup" swaps them, "push the drawer shut" closes it.
        return None
    end = [TaggedWord("SWITCHEDON" if way == "on" else "SWITCHEDOFF", way)] if way else []
    return [TaggedWord("OPERATE", part or "operate"), *rest, *end]


def _without_part(words: list[TaggedWord], around: Surroundings) -> tuple[list[TaggedWord], str]:
    """Return the words with the thing in place of its button or knob, and what that is called; "" without one."""
    place = next((k for k, word in enumerate(words) if word.text in PART_OF or word.text in _EITHER), None)
    if place is None:
        return words, ""
    part, before, after = words[place].text, words[:place], words[place + 1 :]
    named = before[:-1] if before and before[-1].terminal == "POSSESSIVE" else before
    if after and after[0].terminal in _LINKS and len(after) > 1:
        return after[1:], part
    if any(word.terminal not in _ARTICLES for word in named):
        return [*named, *after], part
    wanted = PART_OF.get(part)
    owners = [key for key in around.scene.objects if (has := around.control(key)) and wanted in (None, has)]
    if len(owners) != 1:
        problem = f'"the {part}" can be that of {alternatives(owners)}' if owners else f"nothing here has a {part}"
        instead = [switching_of(key, around) for key in owners]
        raise Refusal("ambiguous-object" if owners else "affordance", problem, among=owners, instead=instead)
    return [TaggedWord("WORD", owners[0]), *after], part
