"""Whether a task's own sentence, its name or description, asks for what its goal says."""

from __future__ import annotations

import re
from collections.abc import Iterator

import bddl
from bddl.semantics.ground import All, Leaf, Negation, Some
from llm.answers.conversation import finding
from llm.errors import QueryError
from llm.offline.lexicon import Lexicon, built_in
from llm.offline.understand import LONGEST_QUERY, Meaning, understand
from llm.offline.wish import IntentKind
from oag import Diagnostic, Scene, Task
from oag.model.diagnostic import TASK_GOAL

_ANNOUNCEMENT = re.compile(r"(?:the|your) (?:task|goal|job) is to ", re.IGNORECASE)
# A literal as a text, and whether it is wanted.
_Literals = frozenset[tuple[str, bool]]


def other_readings(task: Task, scene: Scene, lexicon: Lexicon | None = None) -> tuple[Diagnostic, ...]:
    """Return a warning for each sentence in a task that asks for something else than the task goal says.

    Read are the task's name with its underscores as blanks, its description, and "The task is to ..." in it. What the
    offline planner cannot read in the scene says nothing.

    Args:
        task: The task; its goal must be given.
        scene: The scene that its words are about.
        lexicon: The words to know; None for the built-in ones.
    """
    wanted = _literals(task.goal, scene) if task.goal_given else None
    if wanted is None:
        return ()
    found: dict[tuple[_Literals, _Literals], Diagnostic] = {}
    for sentence in _sentences(task):
        try:
            meaning = understand(sentence, scene, lexicon or built_in())
        except QueryError:
            continue
        asked, optional = _literals(meaning.goal, scene) or frozenset(), _optional(meaning)
        missing, more = asked - optional - wanted, wanted - optional - asked
        if missing or more:
            found.setdefault((missing, more), _difference(sentence, missing, more))
    return tuple(found.values())


def _sentences(task: Task) -> Iterator[str]:
    announced = (part for part in re.split(r"(?<=[.!?])\s+", task.detail) if _ANNOUNCEMENT.match(part))
    for text in (task.name.replace("_", " "), task.detail, *announced):
        if text.strip() and len(text) <= LONGEST_QUERY:
            yield text


def _optional(meaning: Meaning) -> _Literals:
    """Return what a goal may say or leave out: how doors are in the end that are opened on the way.

    "Open the refrigerator and put the glass into it" describes the way as often as it wants an open refrigerator. A
    closing that is asked for is no such case.
    """
    intents, around = meaning.request.intents, meaning.around
    moves = (intent for intent in intents if not intent.kind.is_about_a_door)
    on_the_way = {door for intent in moves for door in around.doors_in_the_way(intent)}
    closed = {intent.target for intent in intents if intent.kind is IntentKind.CLOSE}
    doors = {bddl.format(bddl.Atom("open", (door,))) for door in on_the_way - closed}
    return frozenset((door, wanted) for door in doors for wanted in (True, False))


def _literals(goal: bddl.Formula, scene: Scene) -> _Literals | None:
    """Return the literals of a goal, "for all" spelled out; None where it leaves a choice."""
    plain = bddl.literals(goal)
    if plain is not None:
        return frozenset((bddl.format(atom), wanted) for atom, wanted in plain)
    grounded = bddl.ground(goal, scene.categories)
    found: set[tuple[str, bool]] = set()
    pending = [(grounded.root, True)]
    while pending:
        node, wanted = pending.pop()
        if isinstance(node, Leaf):
            found.add((bddl.format(grounded.atoms[node.atom]), wanted))
        elif isinstance(node, Negation):
            pending.append((node.body, not wanted))
        elif isinstance(node, All if wanted else Some):
            pending.extend((part, wanted) for part in node.parts)
        else:
            return None
    return frozenset(found)


def _difference(sentence: str, missing: _Literals, more: _Literals) -> Diagnostic:
    parts = [f"{_text(missing)} is asked for and not in the goal"] if missing else []
    parts += [f"{_text(more)} is in the goal and not asked for"] if more else []
    shown = sentence if len(sentence) <= 200 else f"{sentence[:200]}..."
    message = f'the sentence "{shown}" has another goal: {"; ".join(parts)}'
    hint = "correct the goal, or the sentence: policies are trained on the one and judged by the other"
    return finding("answer/other-reading", message, TASK_GOAL, hint=hint, severity="warning")


def _text(literals: _Literals) -> str:
    return ", ".join(atom if wanted else f"(not {atom})" for atom, wanted in sorted(literals))
