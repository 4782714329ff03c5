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
from llm.offline.reader import TOO_LONG, Reading, is_too_long, read
from llm.offline.steps import goal_of
from llm.offline.surroundings import Surroundings, doors_in_the_way
from llm.offline.wish import Intent, IntentKind, Refusal, Request, enumeration
from llm.offline.wishes import Interpretation, interpretation, no_action
from llm.offline.words import Word, read_words
from oag import Scene

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


@dataclass(frozen=True, slots=True)
class Understanding:
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


def understand(query: str, scene: Scene, lexicon: Lexicon) -> Understanding:
    """Returns the wishes that a query expresses in a scene, and their goal.

    Args:
        query: English, one wish or several in order.
        scene: The scene that its words are about.
        lexicon: The words to know.

    Raises:
        QueryError: The query is not understood, can mean several things, or cannot be done here.
    """
    if len(query) > LONGEST_QUERY:
        raise QueryError("too-long", query, f"it has {len(query)} characters, and the most are {LONGEST_QUERY}")
    entries = {thing.category: lexicon.category_of(thing.category) for thing in scene.objects.values()}
    listed = {category: entry.affordances for category, entry in entries.items() if entry is not None}
    around = Surroundings.of(scene, listed.get)
    grounding = Grounding.of(around, lexicon)
    words = read_words(query, lexicon)
    try:
        meaning = _known_words(words.tokens, grounding)
    except Refusal as refusal:
        # Different readings are plans already, whatever else they ask for that is so.
        readable = refusal.code == "ambiguous-reading"
        wishes: Sequence[Intent | Request] = [w for w in refusal.instead if readable or is_possible(w, around)]
        suggestions = [text for text in map(str, wishes) if not is_too_long(read_words(text, lexicon).tokens)]
        suggestions = suggestions or [str(wish) for wish in _nearest(words.tokens, grounding)]
        raise QueryError(
            refusal.code,
            query,
            refusal.problem,
            understood=refusal.understood,
            scene=refusal.scene,
            suggestions=suggestions[:_MOST_SUGGESTIONS],
        ) from None
    notes = [f'"{phrase}" changes nothing in the plan' for phrase in words.manner]
    notes += [*meaning.notes, *_assumptions(meaning.request, around)]
    notes = list(dict.fromkeys(notes))
    return Understanding(meaning.request, goal_of(meaning.request, around), around, tuple(notes))


def _known_words(tokens: Sequence[Word], grounding: Grounding) -> Interpretation:
    """Returns the wishes of a query whose every word is known, or raises the Refusal that names those that are not."""
    strange = strangers(tokens, grounding.names)
    if not strange:
        return _interpret(tokens, grounding)
    other: Refusal | None = None
    try:
        _interpret(tokens, grounding)
    except Refusal as refusal:
        other = refusal
    raise refusal_of(strange, grounding.names, other)


def _interpret(tokens: Sequence[Word], grounding: Grounding) -> Interpretation:
    """Returns the wishes, or raises the Refusal that says most about why there is none."""
    if not any(token.terminal not in ("COMMA", "STOP") for token in tokens):
        raise Refusal("empty", "it asks for nothing")
    if is_too_long(tokens):
        raise Refusal("too-long", f"it is too long: {TOO_LONG}; ask for a few things in short sentences")
    readings = read(tokens)
    if not readings:
        raise _unreadable(tokens, grounding)
    return interpret(readings, grounding)


def _unreadable(tokens: Sequence[Word], grounding: Grounding) -> Refusal:
    """Returns the refusal of a query that has none of the grammar's forms."""
    limits = [token.text for token in tokens if token.terminal == "LIMIT"]
    if limits:
        return Refusal(
            "not-understood",
            f'"{limits[0]}" limits, turns or asks something, and the offline planner reads plain wishes only',
        )
    unknown = [token.text for token in tokens if token.terminal == "WORD"]
    unnamed = [word for word in unknown if not grounding.names.mentioned((word,))]
    if not any(token.terminal in _ACTIONS for token in tokens):
        phrases = ((phrase, verb) for verb in _VERBS for phrase in grounding.names.lexicon.phrases(verb))
        verbs = {phrase: verb for phrase, verb in phrases if not phrase.endswith("ing")}
        near = [name for word in unnamed for name in bddl.near_names(word, verbs)]
        return no_action(tuple({verbs[name]: name for name in reversed(near)}.values())[::-1])
    understood = " ".join(token.text for token in tokens)
    return Refusal(
        "not-understood",
        "it knows every word, but no sentence of this form",
        understood=understood,
    )


def _nearest(tokens: Sequence[Word], grounding: Grounding) -> list[Intent]:
    """Returns wishes that can be planned here, those nearest to the query's words first."""
    mentioned = grounding.names.mentioned(tuple(token.text for token in tokens))
    kinds = {_VERBS[token.terminal] for token in tokens if token.terminal in _VERBS}
    wishes = possible(grounding.around, mentioned or tuple(grounding.around.scene.objects))

    def distance(wish: Intent) -> tuple[bool, bool, int]:
        things = [grounding.around.scene.objects[key].category for key in (wish.target, wish.destination) if key]
        # A thing put into another of its kind is possible, and hardly ever meant.
        alike = len(set(things)) < len(things)
        return (alike, wish.kind not in kinds, -len({wish.target, wish.destination} & set(mentioned)))

    return sorted(wishes, key=distance)


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
    last = {intent.target: intent.kind for intent in request.intents if intent.kind.is_about_a_door}
    if len(request.intents) > 1:
        left_open = [door for door, kind in last.items() if kind is IntentKind.OPEN and door in _entered(request)]
        notes += [f"{door} stays open, since no wish closes it again" for door in left_open]
    return notes


def _assumed(intent: Intent, state: Surroundings, opened: Collection[str]) -> list[str]:
    """Returns what one wish supposes or leaves behind; `opened` are the doors that earlier wishes opened."""
    doors = doors_in_the_way(intent, state)
    notes = [
        f"the scene does not say whether {door} is open; it is planned as closed"
        for door in (*doors, *((intent.target,) if intent.kind.is_about_a_door else ()))
        if state.is_open(door) is None
    ]
    if intent.kind is IntentKind.PICK:
        notes += [f"{door} stays open, since the hand holds {intent.target} at the end" for door in doors]
    destination = intent.destination if intent.relation == "inside" else None
    if destination is not None and destination not in (*doors, *opened) and state.affordances[destination].door:
        notes.append(f"{destination} is open and is left as it was found")
    cargo = () if intent.kind.is_about_a_door else state.cargo(intent.target)
    if cargo:
        notes.append(f"{', '.join(cargo)} stands in or on {intent.target} and moves along with it")
    return notes


def _entered(request: Request) -> tuple[str, ...]:
    """Returns where wishes put something."""
    return tuple(intent.destination for intent in request.intents if intent.destination is not None)


def interpret(readings: Sequence[Reading], grounding: Grounding) -> Interpretation:
    """Returns the one request that the readings allow in the scene.

    Args:
        readings: At least one.
        grounding: Names the scene's objects.

    Raises:
        Refusal: No reading makes sense (the refusal of the one that got furthest), or several different ones do.
    """
    found: dict[Request, Interpretation] = {}
    refusals: list[Refusal] = []
    for reading in readings:
        try:
            meant = interpretation(reading, grounding)
        except Refusal as refusal:
            refusal.in_vain = any(command.kind in ("bare", "nowhere") for command in reading)
            refusal.understood = refusal.understood or "; ".join(str(command) for command in reading)
            refusals.append(refusal)
        else:
            found.setdefault(meant.request, meant)
    undecided = [refusal for refusal in refusals if refusal.leaves_choice]
    if len(found) == 1 and not undecided:
        return next(iter(found.values()))
    if found and not undecided:
        raise Refusal(
            "ambiguous-reading",
            "it can be read in more than one way",
            instead=tuple(found),
        )
    raise max(undecided or refusals, key=lambda refusal: refusal.progress)


# What a refusal can be about where words are not known; any other one rests on words that were taken for names.
_SAYING: tuple[RefusalCode, ...] = ("unknown-object", "unknown-action", "not-understood", "too-long", "empty")
_MOST_SHOWN = 4
_LONGEST_SHOWN = 60


def strangers(tokens: Sequence[Word], names: Names) -> tuple[str, ...]:
    """Returns the runs of words that are no part of any name, of the scene's or of the lexicon's, each once."""
    runs = groupby(tokens, key=lambda token: token.terminal == "WORD" and not names.knows(token.text))
    return tuple(dict.fromkeys(" ".join(token.text for token in run) for strange, run in runs if strange))


def refusal_of(strange: Sequence[str], names: Names, other: Refusal | None) -> Refusal:
    """Returns the refusal that names the words that nobody knows.

    Args:
        strange: Those words, at least one.
        names: What the scene's objects are called.
        other: The refusal that reading the query has led to all the same.
    """
    words = [word for run in strange for word in run.split()]
    strange = [run if len(run) <= _LONGEST_SHOWN else f"{run[:_LONGEST_SHOWN]}..." for run in strange]
    said = [f'"{run}"' for run in strange[:_MOST_SHOWN]]
    said += [f"{len(strange) - _MOST_SHOWN} more"] if len(strange) > _MOST_SHOWN else []
    code = other.code if other is not None and other.code in _SAYING else "not-understood"
    if any(word in names.lexicon.foreign or (word.isalpha() and not word.isascii()) for word in words):
        problem = f"the offline planner reads English only, and does not know {enumeration(said)}"
        return Refusal(code, f"{problem}; a language model may know other languages")
    if names.lexicon.people.issuperset(words):
        problem = f"nothing can be handed to {enumeration(said)}; ask to pick it up, or say where it shall go"
        return Refusal("not-understood", problem)
    if not any(map(str.isalnum, "".join(words))):
        code = "not-understood"
    if code == "unknown-object":
        problem = f"nothing in {names.scene.name} is called {' or '.join(said)}{names.meant(*strange[:_MOST_SHOWN])}"
    elif other is not None and code == other.code and code != "not-understood":
        problem = f"it does not know {enumeration(said)}; {other.problem}"
    else:
        problem = f"it does not know {enumeration(said)}"
    scene = other.scene if other is not None and code == other.code else ()
    return Refusal(code, problem, scene=scene)
