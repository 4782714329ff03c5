"""Module 1, the part that decides: from the query to a wish grounded in the scene, and to the task goal G.

G is read off the query and the scene here, not off the subtasks, so that a decomposition that drops one is found out.

Source: the paper's Semantic Expansion; G is a departure (docs/proposition.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import bddl
from llm.doors import doors_in_the_way
from llm.errors import QueryError
from llm.intent import Intent, IntentKind
from llm.offline.ground import Grounding
from llm.offline.interpret import Interpretation, interpret, is_possible, no_action, possible
from llm.offline.lexicon import Lexicon
from llm.offline.reader import is_too_long, read
from llm.offline.refusal import Refusal
from llm.offline.words import Word, read_words
from llm.surroundings import Surroundings
from oag import Scene

_VERBS = {
    "OPEN": IntentKind.OPEN,
    "CLOSE": IntentKind.CLOSE,
    "PICK": IntentKind.PICK,
    "TAKE": IntentKind.PICK,
    "PUT": IntentKind.PLACE,
}
_ACTIONS = frozenset({*_VERBS, "FORCE", "WANT", "MUST"})
_MOST_SUGGESTIONS = 3


@dataclass(frozen=True, slots=True)
class Understanding:
    """What a query asks for.

    Attributes:
        intent: The wish.
        goal: The task goal G.
        around: The scene and its facts, as the later modules ask them.
        notes: What was taken on trust, for the user to see.
    """

    intent: Intent
    goal: bddl.Formula
    around: Surroundings
    notes: tuple[str, ...] = ()


def understand(query: str, scene: Scene, lexicon: Lexicon) -> Understanding:
    """Returns the wish that a query expresses in a scene, and its goal.

    Args:
        query: One English sentence.
        scene: The scene that its words are about.
        lexicon: The words to know.

    Raises:
        QueryError: The query is not understood, can mean several things, or cannot be done here.
    """
    entries = {thing.category: lexicon.category_of(thing.category) for thing in scene.objects.values()}
    listed = {category: entry.affordances for category, entry in entries.items() if entry is not None}
    around = Surroundings.of(scene, listed.get)
    grounding = Grounding(around, lexicon)
    words = read_words(query, lexicon)
    try:
        meaning = _interpret(words.tokens, grounding)
    except Refusal as refusal:
        wishes = [wish for wish in refusal.instead if is_possible(wish, grounding)]
        wishes = wishes or _nearest(words.tokens, grounding)
        raise QueryError(
            refusal.code,
            query,
            refusal.problem,
            understood=refusal.understood,
            scene=refusal.scene,
            suggestions=[str(wish) for wish in wishes[:_MOST_SUGGESTIONS]],
        ) from None
    notes = [f'"{phrase}" changes nothing in the plan' for phrase in words.manner]
    notes += [*meaning.notes, *_assumptions(meaning.intent, around)]
    return Understanding(meaning.intent, goal_of(meaning.intent, around), around, tuple(notes))


def goal_of(intent: Intent, around: Surroundings) -> bddl.Formula:
    """Returns the task goal G: the wish itself, and doors that had to be opened closed again.

    What was open is left as it was found. After picking something up the hand is not free to close a door, so the
    goal does not ask for it.
    """
    doors = doors_in_the_way(intent, around) if intent.kind is IntentKind.PLACE else ()
    closed_again = tuple(bddl.Not(bddl.Atom("open", (door,))) for door in doors)
    return bddl.And((intent.wish, *closed_again)) if closed_again else intent.wish


def _interpret(tokens: Sequence[Word], grounding: Grounding) -> Interpretation:
    """Returns the wish, or raises the Refusal that says most about why there is none."""
    if not any(token.terminal not in ("COMMA", "STOP") for token in tokens):
        raise Refusal("empty", "it asks for nothing")
    if is_too_long(tokens):
        raise Refusal("too-long", "it is too long; ask for one thing in one short sentence")
    readings = read(tokens)
    if not readings:
        raise _unreadable(tokens, grounding)
    return interpret(readings, grounding)


def _unreadable(tokens: Sequence[Word], grounding: Grounding) -> Refusal:
    """Returns the refusal of a query that has none of the grammar's forms."""
    limits = [token.text for token in tokens if token.terminal == "LIMIT"]
    if limits:
        return Refusal(
            "not-understood", f'"{limits[0]}" limits or turns the wish, and the offline planner plans plain wishes only'
        )
    unknown = [token.text for token in tokens if token.terminal == "WORD"]
    unnamed = [word for word in unknown if not grounding.mentioned((word,))]
    if not any(token.terminal in _ACTIONS for token in tokens):
        verbs = {phrase: verb for verb in _VERBS for phrase in grounding.lexicon.phrases(verb)}
        near = [name for word in unnamed for name in bddl.near_names(word, verbs)]
        return no_action(tuple({verbs[name]: name for name in reversed(near)}.values())[::-1])
    understood = " ".join(token.text for token in tokens if token.text not in unnamed)
    rest = f"; it does not know {', '.join(map(repr, unnamed))}" if unnamed else ""
    return Refusal("not-understood", f"the grammar has no sentence of this form{rest}", understood=understood)


def _nearest(tokens: Sequence[Word], grounding: Grounding) -> list[Intent]:
    """Returns wishes that can be planned here, those nearest to the query's words first."""
    mentioned = grounding.mentioned(tuple(token.text for token in tokens))
    kinds = {_VERBS[token.terminal] for token in tokens if token.terminal in _VERBS}
    wishes = possible(grounding, mentioned or tuple(grounding.around.scene.objects))

    def distance(wish: Intent) -> tuple[bool, int, bool]:
        things = [grounding.around.scene.objects[key].category for key in (wish.target, wish.destination) if key]
        # A thing put into another of its kind is possible, and hardly ever meant.
        alike = len(set(things)) < len(things)
        return (alike, -len({wish.target, wish.destination} & set(mentioned)), wish.kind not in kinds)

    return sorted(wishes, key=distance)


def _assumptions(intent: Intent, around: Surroundings) -> list[str]:
    """Returns what the plan supposes or leaves behind, where the scene or the hand gives no choice."""
    doors = doors_in_the_way(intent, around)
    notes = [
        f"the scene does not say whether {door} is open; it is planned as closed"
        for door in (*doors, *((intent.target,) if intent.kind.is_about_a_door else ()))
        if around.is_open(door) is None
    ]
    if intent.kind is IntentKind.PICK:
        notes += [f"{door} stays open, since the hand holds {intent.target} at the end" for door in doors]
    destination = intent.destination if intent.relation == "inside" else None
    if destination is not None and destination not in doors and around.affordances[destination].door:
        notes.append(f"{destination} is open and is left as it was found")
    cargo = () if intent.kind.is_about_a_door else around.cargo(intent.target)
    if cargo:
        notes.append(f"{', '.join(cargo)} stands in or on {intent.target} and moves along with it")
    return notes
