"""Read a task's own sentences again, and say where their goal and the task goal differ."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

import bddl
from bddl.grounding import All, Leaf, Negation, Some
from llm.errors import QueryError
from llm.offline.intents import IntentKind, enumeration
from llm.offline.lexicon import Lexicon, built_in
from llm.offline.planner import LONGEST_QUERY, Meaning, understand
from llm.structured.conversation import finding
from oag import Diagnostic, Scene, Task
from oag.model.diagnostics import TASK_GOAL
from oag.model.symbols import Kind

_ANNOUNCEMENT = re.compile(r"(?:the|your) (?:task|goal|job) is to ", re.IGNORECASE)
# A literal as a text, and whether it is wanted.
_Literals = frozenset[tuple[str, bool]]


def other_readings(
    task: Task, scene: Scene, lexicon: Lexicon | None = None, *, query: str = ""
) -> tuple[Diagnostic, ...]:
    """Return a warning for each sentence of a task whose goal differs from the task goal.

    The sentences are the query, if it is known, the task's name with its underscores as blanks, its description, and
    "The task is to ..." in it. Where the offline planner can read none of them in the scene, there is a note on items
    that they name and of which the goal says nothing.
    """
    wanted = _literals(task.goal, scene) if task.goal_given else None
    if wanted is None:
        return ()
    found: dict[tuple[_Literals, _Literals], Diagnostic] = {}
    sentences, unread = list(dict.fromkeys(_sentences(task, query))), 0
    for sentence in sentences:
        try:
            meaning = understand(sentence, scene, lexicon or built_in())
        except QueryError:
            unread += 1
            continue
        asked, optional = _literals(meaning.goal, scene) or frozenset(), _optional(meaning)
        missing, more = asked - optional - wanted, wanted - optional - asked
        if missing or more:
            found.setdefault((missing, more), _difference(sentence, missing, more))
    return tuple(found.values()) if unread < len(sentences) else tuple(_forgotten(task, sentences, scene))


def named_in(text: str, ids: Iterable[str]) -> tuple[str, ...]:
    """Return the ids that a text names, as words of their own."""
    return tuple(key for key in ids if re.search(rf"(?<![\w.-]){re.escape(key)}(?![\w-])", text))


def _forgotten(task: Task, sentences: Sequence[str], scene: Scene) -> Iterator[Diagnostic]:
    """Yield a note on the items that sentences name by their ids, and the goal in no way."""
    items = [key for key, thing in scene.objects.items() if thing.kind is Kind.ITEM]
    spoken = {name for atom in bddl.ground(task.goal, scene.categories).atoms for name in atom.args}
    for sentence in sentences:
        left = [key for key in named_in(sentence, items) if key not in spoken]
        if left:
            message = f'"{_shortened(sentence)}" names {enumeration(left)}, and the goal says nothing of it'
            hint = "add to the goal what is wanted of it"
            yield finding("answer/forgotten-object", message, TASK_GOAL, hint=hint, severity="note")
            return


def _sentences(task: Task, query: str) -> Iterator[str]:
    announced = (part for part in re.split(r"(?<=[.!?])\s+", task.detail) if _ANNOUNCEMENT.match(part))
    for text in (query, task.name.replace("_", " "), task.detail, *announced):
        if text.strip() and len(text) <= LONGEST_QUERY:
            yield text


def _optional(meaning: Meaning) -> _Literals:
    """Return the literals that a goal may include or omit: final states of doors that are opened on the way.

    "Open the refrigerator and put the glass into it" describes the procedure as often as it demands an open
    refrigerator. A requested closing is not optional.
    """
    intents, around = meaning.request.intents, meaning.around
    moves = (intent for intent in intents if intent.kind.moves_an_item)
    on_the_way = {door for intent in moves for door in around.doors_in_the_way(intent)}
    closed = {intent.target for intent in intents if intent.kind is IntentKind.CLOSE}
    doors = {bddl.format(bddl.Atom("open", (door,))) for door in on_the_way - closed}
    return frozenset((door, wanted) for door in doors for wanted in (True, False))


def _literals(goal: bddl.Formula, scene: Scene) -> _Literals | None:
    """Return the literals of a goal, with "for all" expanded; None if it has alternatives."""
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
    message = f'the sentence "{_shortened(sentence)}" has another goal: {"; ".join(parts)}'
    hint = "correct the goal, or the sentence: policies are trained on the one and judged by the other"
    return finding("answer/other-reading", message, TASK_GOAL, hint=hint, severity="warning")


def _shortened(sentence: str) -> str:
    return sentence if len(sentence) <= 200 else f"{sentence[:200]}..."


def _text(literals: _Literals) -> str:
    return ", ".join(atom if wanted else f"(not {atom})" for atom, wanted in sorted(literals))
