"""Words of switching: "turn the oven on", "switch off the lamp", "press the button of the microwave", "turn its knob".

They are verbs only where a scene has something with a button or a knob. Elsewhere the words stay what they are, and
the refusal says that no joint of that kind is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from llm.offline.grounding import Grounding
from llm.offline.intents import CONTROLS, Intent, IntentKind, Refusal, Surroundings, alternatives
from llm.offline.names import Names, singulars
from llm.offline.words import ENDS, PREPOSITIONS, TaggedWord

_SWITCHING = frozenset({"turn", "switch", "power", "flip", "toggle", "click"})
"""Verbs that say with "on" or "off" what shall be."""

_PRESSING = frozenset({"press", "push", "operate", "toggle"})
"""Verbs that switch a thing when its name alone follows. The others also turn a thing round, over or aside."""

_OPERATING = _PRESSING | {"hit", "tap", "turn", "twist", "rotate", "flip", "switch"}
"""Verbs for a button or a knob, whichever way it is."""

VERBS = _SWITCHING | _OPERATING
"""All of them."""

_WAYS = {"": "OPERATE", "on": "SWITCHON", "off": "SWITCHOFF"}
_COUNTS = {"ALL": 0, "BOTH": 2, "TWO": 2, "THREE": 3, "FOUR": 4}
_ARTICLES = frozenset({"DETERMINER", "A", "ONE", *_COUNTS})
_LINKS = frozenset({"OF", "ON", "TO", "FROM", "IN"})
_LISTING = frozenset({"AND", "COMMA"})
_SIDED = {"ONLEFT": "LEFT", "ONRIGHT": "RIGHT"}
_ASIDE = frozenset({"TOLEFT", "TORIGHT"})


def can_switch(around: Surroundings) -> bool:
    """Decide whether anything in a scene has a button or a knob."""
    return any(around.control(key) for key in around.scene.objects)


def with_switchings(
    tokens: Sequence[TaggedWord], grounding: Grounding
) -> tuple[tuple[TaggedWord, ...], tuple[str, ...]]:
    """Return a query's words with those of switching tagged as such, and the describing words that were left out.

    "The button of the oven" becomes the oven, since a thing has one button or knob. Where nothing can be switched, the
    words stay as they are.

    Raises:
        Refusal: "The button" alone is that of several things, or of none; or a word says more than on or off.
    """
    if not can_switch(grounding.around):
        return tuple(tokens), ()
    words, found, dropped = list(tokens), list[TaggedWord](), list[str]()
    while words:
        opens = not found or found[-1].terminal in (*ENDS, "LIMIT")
        clause = _clause(words) if opens and words[0].text in VERBS else []
        switched = _switched(clause, grounding, dropped) if clause else None
        if switched is None:
            found.append(words.pop(0))
        else:
            found += switched
            del words[: len(clause)]
    return tuple(found), tuple(dropped)


def switchings(ids: Sequence[str], way: str, part: str, around: Surroundings) -> tuple[Intent, ...]:
    """Return the intents of switching things.

    Args:
        ids: The things.
        way: "switch_on", "switch_off", or "operate", which switches each to what it is not.
        part: What the sentence calls the button or the knob, such as "dial"; "" without.

    Raises:
        Refusal: One of them has no such part, or "buttons" are those of one thing.
    """
    wanted = CONTROLS.get(part, "")
    for key in ids:
        control = around.control(key)
        if control is None or wanted not in ("", control):
            has = "neither a button nor a knob" if control is None else f"a {control} and no {wanted}"
            known = [one for one in around.scene.objects if around.control(one) is not None]
            shown, instead = list(map(around.described, known)), [switching_of(one, around) for one in known]
            raise Refusal("affordance", f"{key} has {has}", scene=shown, instead=instead)
        if _is_plural(part) and len(ids) == 1:
            problem = f'"{part}" are several, and {key} has one {control}'
            raise Refusal("several-objects", problem, instead=[switching_of(key, around)])
    kinds = {"switch_on": IntentKind.SWITCH_ON, "switch_off": IntentKind.SWITCH_OFF}
    return tuple(Intent(kinds[way], key) if way in kinds else switching_of(key, around) for key in ids)


def switching_of(key: str, around: Surroundings) -> Intent:
    """Return the intent of switching a thing to what it is not."""
    return Intent(IntentKind.SWITCH_OFF if around.is_on(key) else IntentKind.SWITCH_ON, key)


def _clause(words: Sequence[TaggedWord]) -> list[TaggedWord]:
    """Return the words of a wish with its whole list of things, up to an "on" or "off" after one of them."""
    ends = [*(index for index, word in enumerate(words) if word.terminal in ENDS), len(words)]
    leads = words[1:] and words[1].text in _WAYS
    for end, after in pairwise((*ends, len(words))):
        more = words[end + 1 : after]
        goes_on = end < len(words) and words[end].terminal in _LISTING and _names_another(words[end + 1 :])
        if not goes_on or not more or (words[end - 1].text in _WAYS and not leads):
            return list(words[:end])
    return list(words)


def _names_another(words: Sequence[TaggedWord]) -> bool:
    """Decide whether words begin with another thing: "the lamp" in "turn the oven and the lamp on"."""
    return bool(words) and words[0].terminal in (*_ARTICLES, "WORD") and words[0].text not in VERBS


def _switched(clause: Sequence[TaggedWord], grounding: Grounding, dropped: list[str]) -> list[TaggedWord] | None:
    """Return the words of a wish to switch something; None for another wish."""
    verb, *rest = clause
    way = ""
    if rest and rest[0].terminal in _SIDED:
        # "Turn on the left lamp".
        side = _SIDED[rest[0].terminal]
        rest = [TaggedWord("ON", "on"), TaggedWord("DETERMINER", "the"), TaggedWord(side, side.lower()), *rest[1:]]
    if verb.text in _SWITCHING and len(rest) > 1:
        if rest[0].text in _WAYS:
            way, rest = rest[0].text, rest[1:]
        elif rest[-1].text in _WAYS:
            way, rest = rest[-1].text, rest[:-1]
    if not way and verb.text not in _OPERATING:
        return None
    listed = _listed(rest)
    reduced = [_without_part(one, len(listed), grounding, dropped) for one in listed]
    if not way and not reduced[0][1] and not _switches_alone(verb, rest):
        return None
    found = list[TaggedWord]()
    for words, part in reduced:
        _check_means_no_more(words, turns=not way)
        if found:
            found.append(TaggedWord("AND", "and"))
        if part or not found:
            # One that names no part goes on with that of the one before: "the button of the microwave and the lamp".
            found.append(TaggedWord(_WAYS[way], part or (f"switch {way}" if way else "operate")))
        found += words
    return found


def _switches_alone(verb: TaggedWord, rest: Sequence[TaggedWord]) -> bool:
    """Decide whether a verb without "on", "off" and a part switches what follows; False for another meaning of it.

    Raises:
        Refusal: It says neither that nor anything else that a plan does: "rotate the oven".
    """
    if verb.terminal != "WORD":
        # "Switch the mug and the cup" swaps them, "push the drawer shut" closes it.
        return False
    if any(word.terminal == "LIMIT" for word in rest):
        return True  # That word is the reason why it is refused: "turn the mug upside down".
    if verb.text not in _PRESSING or not rest:
        problem = f'"{verb.text}" alone does not say what is switched: say "on" or "off", or name the button or knob'
        raise Refusal("unknown-action", problem)
    return True


def _listed(words: Sequence[TaggedWord]) -> list[list[TaggedWord]]:
    """Return the words of each of several things."""
    found = [list[TaggedWord]()]
    for word in words:
        if word.terminal in _LISTING:
            found.append([])
        else:
            found[-1].append(word)
    return [one for one in found if one] or [[]]


def _check_means_no_more(words: Sequence[TaggedWord], *, turns: bool) -> None:
    """Raise the refusal of words about a door of the thing, or about the way in which something turns."""
    place = next((k for k, word in enumerate(words) if word.terminal in PREPOSITIONS), len(words))
    if any(word.terminal == "DOOR" for word in words[:place]):
        named = " ".join(word.text for word in words[:place])
        raise Refusal(
            "affordance", f'"{named}" is a door or a drawer, which is opened and closed, and switches nothing'
        )
    aside = next((word.text for word in words if word.terminal in _ASIDE), None)
    if turns and aside is not None:
        raise Refusal("not-understood", f'"{aside}" says which way, and a plan knows on and off only: say which')


def _without_part(
    words: list[TaggedWord], among: int, grounding: Grounding, dropped: list[str]
) -> tuple[list[TaggedWord], str]:
    """Return the words with the thing in place of its button or knob, and what that is called; "" without one.

    Args:
        among: How many things the wish lists.
    """
    names = grounding.names
    place = next(
        (k for k, word in enumerate(words) if word.text in CONTROLS and not _is_in_a_name(words, k, names)), None
    )
    if place is None:
        return words, ""
    part, before, after = words[place].text, words[:place], words[place + 1 :]
    owner = max((k for k, word in enumerate(before) if word.terminal == "POSSESSIVE"), default=None)
    describing = [word for word in before[0 if owner is None else owner + 1 :] if word.terminal not in _ARTICLES]
    is_linked = len(after) > 1 and after[0].terminal in _LINKS
    if owner is None and _names_a_thing(describing, grounding, is_linked=is_linked):
        # "The microwave button".
        return [*before, *after], part
    if not all(_describes(word, names) for word in describing):
        # "The start button", "the left button": a part is not told apart so.
        named = " ".join(word.text for word in describing)
        raise Refusal("not-understood", f'"{named}" says which {part} is meant, and a thing has one; leave it out')
    dropped += [" ".join(word.text for word in describing)] if describing else []
    if owner is not None:
        return [*before[:owner], *after], part
    count = next((word for word in before if word.terminal in _COUNTS), None)
    if is_linked:
        if count is not None and _COUNTS[count.terminal] not in (0, among):
            raise Refusal("several-objects", f'"{count.text} {part}" counts them, and a thing has one; name each thing')
        return after[1:], _called(part, count)
    owners = _owners(part, count, grounding.around)
    listed = [word for key in owners for word in (TaggedWord("AND", "and"), TaggedWord("WORD", key))][1:]
    return [*listed, *after], _called(part, count)


def _called(part: str, count: TaggedWord | None) -> str:
    """Return what a part is called; "all knobs" may be one."""
    return part if count is None or count.terminal != "ALL" else CONTROLS[part] or "operate"


def _owners(part: str, count: TaggedWord | None, around: Surroundings) -> list[str]:
    """Return what "the knob", "the knobs" or "both knobs" belong to where the words do not say it.

    Raises:
        Refusal: So many are not there, or it can be that of several.
    """
    wanted = CONTROLS[part]
    owners = [key for key in around.scene.objects if (has := around.control(key)) and wanted in ("", has)]
    instead = [switching_of(key, around) for key in owners]
    if not owners:
        raise Refusal("affordance", f"nothing here has a {wanted}")
    if count is not None and _COUNTS[count.terminal] not in (0, len(owners)):
        problem = f'"{count.text} {part}" does not fit the scene, which has {len(owners)}: {alternatives(owners, ", ")}'
        raise Refusal("several-objects", problem, instead=instead)
    if len(owners) > 1 and count is None and not _is_plural(part):
        raise Refusal(
            "ambiguous-object",
            f'"the {part}" can be that of {alternatives(owners)}',
            among=owners,
            instead=instead,
        )
    return owners


def _names_a_thing(words: Sequence[TaggedWord], grounding: Grounding, *, is_linked: bool) -> bool:
    """Decide whether the words before a part name its owner: "microwave", unlike "red", and "start" before "of"."""
    names = grounding.names
    ids = names.described(tuple(word.text for word in words if word.terminal == "WORD")).ids
    if any(grounding.around.control(key) for key in ids):
        return True
    nouns = bool(words) and words[-1].terminal in ("WORD", "DOOR") and not all(_describes(one, names) for one in words)
    return nouns and not is_linked


def _describes(word: TaggedWord, names: Names) -> bool:
    """Decide whether a word describes a button or a knob and tells none apart: "red", and "push" before "button"."""
    return word.text in names.lexicon.descriptions or word.text == "push"


def _is_plural(part: str) -> bool:
    return part.endswith("s")


def _is_in_a_name(words: Sequence[TaggedWord], place: int, names: Names) -> bool:
    """Decide whether a word belongs to the name of a thing: "control" of "the remote control"."""
    texts = [word.text for word in words]
    runs = (" ".join(texts[start:stop]) for start in range(place + 1) for stop in range(place + 1, len(texts) + 1))
    return any(names.by_name(form).ids or names.lexicon.owners(form) for run in runs for form in (run, *singulars(run)))
