"""Module 1, the part that decides: from the query to wishes grounded in the scene, and to the task goal G.

G is read off the query and the scene here, not off the subtasks, so that a decomposition that drops one is found out.

Source: the paper's Semantic Expansion; G is a departure (docs/proposition.md).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import groupby

import bddl
from llm.errors import QueryError, RefusalCode
from llm.offline.feasible import is_possible, possible
from llm.offline.ground import Grounding
from llm.offline.lexicon import Lexicon
from llm.offline.names import Names
from llm.offline.reader import TOO_LONG, Reading, TaggedWord, is_too_long, read, read_words
from llm.offline.steps import goal_of
from llm.offline.surroundings import Surroundings
from llm.offline.wish import Intent, IntentKind, Refusal, Request, enumeration
from llm.offline.wishes import interpretation, no_action
from oag import Scene
from oag.task.sizes import TO_THE_AIM, Sizing

_VERBS = {
    "OPEN": IntentKind.OPEN,
    "CLOSE": IntentKind.CLOSE,
    "PICK": IntentKind.PICK,
    "TAKE": IntentKind.PICK,
    "PUT": IntentKind.PLACE,
    "CLEAR": IntentKind.PLACE,
}
_ACTIONS = frozenset({*_VERBS, "FORCE", "PULL", "WANT", "MUST", "CONTAIN"})
_MOST_SUGGESTIONS = 3
LONGEST_QUERY = 2_000
"""Most characters of a query; the longest sentence that one can be read in needs a quarter of them."""

# What a refusal can be about where words are not known; any other one rests on words that were taken for names.
_OF_WORDS: tuple[RefusalCode, ...] = ("unknown-object", "unknown-action", "not-understood", "too-long", "empty")
_MOST_STRANGERS = 4
_LONGEST_STRANGER = 60


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a query asks for.

    Attributes:
        request: The wishes, in order.
        goal: The task goal G.
        around: The scene and its facts, as the later modules ask them.
        notes: What was taken on trust, for the user to see.
    """

    request: Request
    goal: bddl.Formula
    around: Surroundings
    notes: tuple[str, ...] = ()


def understand(query: str, scene: Scene, lexicon: Lexicon, sizing: Sizing = TO_THE_AIM) -> Meaning:
    """Returns the wishes that a query expresses in a scene, and their goal.

    Args:
        query: English, one wish or several in order.
        scene: The scene that its words are about.
        lexicon: The words to know.
        sizing: What becomes of sizes, where one thing has to go into another.

    Raises:
        QueryError: The query is not understood, can mean several things, or cannot be done here.
    """
    if len(query) > LONGEST_QUERY:
        raise QueryError("too-long", query, f"it has {len(query)} characters, and the most are {LONGEST_QUERY}")
    grounding = Grounding.of(scene, lexicon, sizing)
    around = grounding.around
    tokens, manner = read_words(query, lexicon)
    try:
        request, trusted = _of_known_words(tokens, grounding)
    except Refusal as refusal:
        # Different readings are plans already, whatever else they ask for that is so.
        readable = refusal.code == "ambiguous-reading"
        wishes: Sequence[Intent | Request] = [w for w in refusal.instead if readable or is_possible(w, around)]
        suggestions = [text for text in map(str, wishes) if not is_too_long(read_words(text, lexicon)[0])]
        suggestions = suggestions or [str(wish) for wish in _nearest(tokens, grounding)]
        raise QueryError(
            refusal.code,
            query,
            refusal.problem,
            understood=refusal.understood,
            scene=refusal.scene,
            suggestions=suggestions[:_MOST_SUGGESTIONS],
        ) from None
    notes = [f'"{phrase}" changes nothing in the plan' for phrase in manner]
    notes += [*trusted, *_assumptions(request, around)]
    return Meaning(request, goal_of(request, around), around, tuple(dict.fromkeys(notes)))


def _of_known_words(tokens: Sequence[TaggedWord], grounding: Grounding) -> tuple[Request, tuple[str, ...]]:
    """Returns the wishes of a query whose every word is known, or raises the Refusal that names those that are not."""
    names = grounding.names
    runs = groupby(tokens, key=lambda token: token.terminal == "WORD" and not names.knows(token.text))
    strange = tuple(dict.fromkeys(" ".join(token.text for token in run) for unknown, run in runs if unknown))
    other: Refusal | None = None
    try:
        meant = _interpreted(tokens, grounding)
    except Refusal as refusal:
        if not strange:
            raise
        other = refusal
    else:
        if not strange:
            return meant
    raise _strange_words(strange, names, other)


def _interpreted(tokens: Sequence[TaggedWord], grounding: Grounding) -> tuple[Request, tuple[str, ...]]:
    """Returns the wishes, or raises the Refusal that says most about why there is none."""
    if not any(token.terminal not in ("COMMA", "STOP") for token in tokens):
        raise Refusal("empty", "it asks for nothing")
    if is_too_long(tokens):
        raise Refusal("too-long", f"it is too long: {TOO_LONG}; ask for a few things in short sentences")
    readings = read(tokens)
    if not readings:
        raise _unreadable(tokens, grounding)
    return interpret(readings, grounding)


def interpret(readings: Sequence[Reading], grounding: Grounding) -> tuple[Request, tuple[str, ...]]:
    """Returns the one request that the readings (at least one) allow in the scene, and what was taken on trust.

    Raises:
        Refusal: No reading makes sense (the refusal of the one that got furthest), or several different ones do.
    """
    found: dict[Request, tuple[str, ...]] = {}
    refusals: list[Refusal] = []
    for reading in readings:
        try:
            request, notes = interpretation(reading, grounding)
        except Refusal as refusal:
            refusal.in_vain = any(command.kind in ("bare", "nowhere") for command in reading)
            refusal.understood = refusal.understood or "; ".join(str(command) for command in reading)
            refusals.append(refusal)
        else:
            found.setdefault(request, notes)
    undecided = [refusal for refusal in refusals if refusal.leaves_choice]
    if found and not undecided:
        if len(found) == 1:
            return next(iter(found.items()))
        raise Refusal("ambiguous-reading", "it can be read in more than one way", instead=tuple(found))
    raise max(undecided or refusals, key=lambda refusal: refusal.progress)


def _unreadable(tokens: Sequence[TaggedWord], grounding: Grounding) -> Refusal:
    limit = next((token.text for token in tokens if token.terminal == "LIMIT"), None)
    if limit is not None:
        problem = f'"{limit}" limits, turns or asks something, and the offline planner reads plain wishes only'
        return Refusal("not-understood", problem)
    if not any(token.terminal in _ACTIONS for token in tokens):
        unknown = [token.text for token in tokens if token.terminal == "WORD"]
        unnamed = [word for word in unknown if not grounding.names.mentioned((word,))]
        phrases = ((phrase, verb) for verb in _VERBS for phrase in grounding.names.lexicon.phrases(verb))
        verbs = {phrase: verb for phrase, verb in phrases if not phrase.endswith("ing")}
        near = [name for word in unnamed for name in bddl.near_names(word, verbs)]
        return no_action(tuple({verbs[name]: name for name in reversed(near)}.values())[::-1])
    understood = " ".join(token.text for token in tokens)
    return Refusal("not-understood", "it knows every word, but no sentence of this form", understood=understood)


def _strange_words(strange: Sequence[str], names: Names, other: Refusal | None) -> Refusal:
    """Returns the refusal that names the words that nobody knows: no part of any name, of the scene's or lexicon's.

    Args:
        strange: Those words, at least one, in runs.
        names: What the scene's objects are called.
        other: The refusal that reading the query has led to all the same.
    """
    words = [word for run in strange for word in run.split()]
    strange = [run if len(run) <= _LONGEST_STRANGER else f"{run[:_LONGEST_STRANGER]}..." for run in strange]
    said = [f'"{run}"' for run in strange[:_MOST_STRANGERS]]
    said += [f"{len(strange) - _MOST_STRANGERS} more"] if len(strange) > _MOST_STRANGERS else []
    unknown = f"it does not know {enumeration(said)}"
    code = other.code if other is not None and other.code in _OF_WORDS else "not-understood"
    if any(word in names.lexicon.foreign or (word.isalpha() and not word.isascii()) for word in words):
        problem = f"the offline planner reads English only, and does not know {enumeration(said)}"
        return Refusal(code, f"{problem}; a language model may know other languages")
    if names.lexicon.people.issuperset(words):
        problem = f"nothing can be handed to {enumeration(said)}; ask to pick it up, or say where it shall go"
        return Refusal("not-understood", problem)
    if not any(map(str.isalnum, "".join(words))):
        code = "not-understood"
    if code == "unknown-object":
        meant = names.meant(*strange[:_MOST_STRANGERS])
        unknown = f"nothing in {names.scene.name} is called {' or '.join(said)}{meant}"
    elif other is not None and code == other.code and code != "not-understood":
        unknown = f"{unknown}; {other.problem}"
    return Refusal(code, unknown, scene=other.scene if other is not None and code == other.code else ())


def _nearest(tokens: Sequence[TaggedWord], grounding: Grounding) -> list[Intent]:
    """Return wishes that can be planned here, those nearest to the query's words first.

    Where the query has a subject, an item to move or a thing to open, and anything can be done with it, all are about
    that subject: advice about another thing is no help.
    """
    around, mentioned = grounding.around, grounding.names.mentioned(tuple(token.text for token in tokens))
    kinds = {_VERBS[token.terminal] for token in tokens if token.terminal in _VERBS}
    objects = around.scene.objects

    def is_subject(key: str) -> bool:
        if kinds and all(kind.is_about_a_door for kind in kinds):
            return around.affordances[key].door
        return objects[key].role == "B"

    def distance(wish: Intent) -> tuple[bool, bool, int]:
        things = [objects[key].category for key in (wish.target, wish.destination) if key]
        # A thing put into another of its kind is possible, and hardly ever meant.
        alike = len(set(things)) < len(things)
        return (alike, wish.kind not in kinds, -len({wish.target, wish.destination} & set(mentioned)))

    wishes = possible(around, mentioned or tuple(objects))
    subject = next(filter(is_subject, mentioned), None)
    return sorted([wish for wish in wishes if wish.target == subject] or wishes, key=distance)


def _assumptions(request: Request, around: Surroundings) -> list[str]:
    """Returns what the plan supposes or leaves behind, where the scene or the hand gives no choice."""
    notes: list[str] = []
    state = around
    opened: set[str] = set()
    for intent in request.intents:
        if not state.fulfils(intent):
            notes += _assumed(intent, state, opened)
        if intent.kind is IntentKind.OPEN:
            opened.add(intent.target)
        state = state.after(intent)
    if len(request.intents) > 1:
        last = {intent.target: intent.kind for intent in request.intents if intent.kind.is_about_a_door}
        entered = {intent.destination for intent in request.intents}
        left_open = [door for door, kind in last.items() if kind is IntentKind.OPEN and door in entered]
        notes += [f"{door} stays open, since no wish closes it again" for door in left_open]
    return notes


def _assumed(intent: Intent, state: Surroundings, opened: Collection[str]) -> list[str]:
    """Returns what one wish supposes or leaves behind; `opened` are the doors that earlier wishes opened."""
    doors = state.doors_in_the_way(intent)
    asked = (*doors, *((intent.target,) if intent.kind.is_about_a_door else ()))
    unknown = [door for door in asked if state.is_open(door) is None]
    notes = [f"the scene does not say whether {door} is open; it is planned as closed" for door in unknown]
    if intent.kind is IntentKind.PICK:
        notes += [f"{door} stays open, since the hand holds {intent.target} at the end" for door in doors]
    destination = intent.destination if intent.relation == "inside" else None
    if destination is not None and destination not in (*doors, *opened) and state.affordances[destination].door:
        notes.append(f"{destination} is open and is left as it was found")
    cargo = () if intent.kind.is_about_a_door else state.cargo(intent.target)
    if cargo:
        notes.append(f"{', '.join(cargo)} stands in or on {intent.target} and moves along with it")
    return notes
