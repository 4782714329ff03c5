"""Candidates for fixes of well-formed plans that move, exchange, leave out or insert whole subtasks."""

from __future__ import annotations

from collections.abc import Iterator

import bddl
from oag.flows import (
    CLOSE,
    OPEN,
    PICK,
    PLACE,
    TAKE_OUT,
    PrimitiveFlow,
)
from oag.model.actions import Action, ActionFlow
from oag.model.symbols import (
    EMPTY,
    GRIPPER,
    HAND,
    Condition,
    Kind,
    condition_of,
    held_by,
    holding,
)
from oag.primitives.cargo import RESTING
from oag.primitives.table import Placement
from oag.task_definition import SimpleTask
from oag.verify.edits import (
    DeleteSubtask,
    InsertSubtask,
    MoveSubtask,
    SwapSubtasks,
)
from oag.verify.fix_candidates import Candidate, Cost, Mistake, numbered

# In longer plans only the subtasks within this many places of a mistake and of its writer are moved.
_SUBTASK_REACH = 6


def order_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidates that put the same subtasks in another order, the nearest places first."""
    near = _near(mistake)
    for first in near:
        for second in near:
            distance, one, other = abs(first - second), _named(mistake, first), _named(mistake, second)
            rank = 2 * distance + (0 if mistake.subtask in (first, second) else 5)
            if first < second:
                swap, words = SwapSubtasks(first, second), f"exchange {one} and {other}"
                yield Candidate(Cost.MOVE, "swap-subtasks", words, (swap,), first, rank=rank)
            if distance > 1:
                words = f"move {one} {'before' if second < first else 'after'} {other}"
                yield Candidate(Cost.MOVE, "move-subtask", words, (MoveSubtask(first, second),), first, rank=rank)


def deletion_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidates that leave a subtask out."""
    for index in _near(mistake):
        words = f"leave out {_named(mistake, index)}"
        rank = 0 if index in (mistake.subtask, mistake.writer) else 1
        yield Candidate(Cost.DELETION, "delete-subtask", words, (DeleteSubtask(index),), index, rank=rank)


def insertion_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidates that insert a subtask for the missing literal, the latest place first."""
    count = len(mistake.task.subtasks)
    latest = min(mistake.subtask, count)
    places = [p for p in range(latest, -1, -1) if latest - p <= 2 * _SUBTASK_REACH or p == 0]
    for parts in dict.fromkeys(part for wanted in _wanted(mistake) for part in _means(mistake, wanted)):
        for place in places:
            edits = tuple(InsertSubtask(place + offset, part) for offset, part in enumerate(parts))
            text = " and then ".join(f'"{_detail_text(part)}"' for part in parts)
            cost = Cost.SUBTASK if len(parts) == 1 else Cost.TWO_SUBTASKS
            words = f"insert {text} {_before(mistake, place)}"
            yield Candidate(cost, "insert-subtask", words, edits, place, rank=latest - place)
        if len(parts) == 1 and parts[0] == opening(parts[0].target):
            yield from _open_and_close(mistake, parts[0], places, latest)


def _open_and_close(mistake: Mistake, part: SimpleTask, places: list[int], latest: int) -> Iterator[Candidate]:
    """Yield the candidates that open a fixture where it is needed and close it afterwards."""
    count = len(mistake.task.subtasks)
    shut = closing(part.target)
    for place in places:
        for end in dict.fromkeys((min(latest + 2, count + 1), count + 1)):
            edits = (InsertSubtask(place, part), InsertSubtask(end, shut))
            where = "at the end" if end == count + 1 else f"before {_named(mistake, end - 1)}"
            words = f'insert "{_detail_text(part)}" {_before(mistake, place)} and "{_detail_text(shut)}" {where}'
            yield Candidate(Cost.TWO_SUBTASKS, "insert-subtask", words, edits, place, rank=latest - place)


def _wanted(mistake: Mistake) -> Iterator[Condition]:
    if mistake.condition is not None:
        yield mistake.condition
        return
    if mistake.obligation is not None:
        for link in mistake.obligation.links:
            yield link.condition._replace(positive=not link.condition.positive)
        return
    if mistake.finding.code == "flow/no-flow" and mistake.subtask < len(mistake.task.subtasks):
        subtask = mistake.task.subtasks[mistake.subtask]
        yield Condition(HAND, holding(subtask.target))
        yield Condition(HAND, EMPTY)
        for fixture in mistake.scene.objects:
            yield Condition(("open", fixture), True)
        for literal in bddl.literals(subtask.goal) or ():
            yield condition_of(literal.atom, literal.value)


def _means(mistake: Mistake, wanted: Condition) -> Iterator[tuple[SimpleTask, ...]]:
    """Yield the simple tasks that make a literal true; some need two, one after the other."""
    fact, objects = wanted.fact, mistake.scene.objects
    if fact[0] == "open" and fact[1] in objects and objects[fact[1]].kind is Kind.ARTICULATED:
        yield (opening(fact[1]),) if wanted.positive else (closing(fact[1]),)
    elif fact == HAND and wanted.positive and wanted.value != EMPTY:
        yield from ((part,) for part in _pickings(mistake, held_by(wanted.value)))
    elif fact == HAND:
        yield from ((part,) for part in _placings(mistake))
    elif fact[0] in RESTING and _is_item(mistake, fact[1]):
        if not wanted.positive:
            yield from ((part,) for part in _pickings(mistake, fact[1]))
        elif fact[2] != GRIPPER:
            put = placing(fact[1], Placement(fact[0], fact[2]))
            yield (put,)
            yield from ((part, put) for part in _pickings(mistake, fact[1]))


def _pickings(mistake: Mistake, item: str | None) -> Iterator[SimpleTask]:
    """Yield the subtasks that pick an item up, from every place where it ever is."""
    if item is None or not _is_item(mistake, item):
        return
    for place in _places_of(mistake, item):
        yield picking(item, place)
    yield picking(item, None)


def _placings(mistake: Mistake) -> Iterator[SimpleTask]:
    """Yield the subtasks that free the hand: at the item's goals, or where it ever was."""
    item = held_by(mistake.entry.value) if mistake.entry is not None else None
    if item is None and mistake.trace is not None:
        item = held_by(mistake.trace.state.hand)
    if item is None:
        return
    goals = (*(subtask.goal for subtask in mistake.task.subtasks), mistake.task.goal)
    aimed = [
        Placement(literal.atom.predicate, literal.atom.args[1])
        for goal in goals
        for literal in bddl.literals(goal) or ()
        if literal.value and literal.atom.predicate in RESTING and literal.atom.args[0] == item
    ]
    for place in dict.fromkeys((*aimed, *_places_of(mistake, item))):
        if place.support in mistake.scene.objects:
            yield placing(item, place)


def _places_of(mistake: Mistake, item: str) -> tuple[Placement, ...]:
    if mistake.trace is None:
        return ()
    facts = [fact for fact, _ in mistake.trace.state.entries() if len(fact) == 3 and fact[0] in RESTING]
    return tuple(
        Placement(fact[0], fact[2])
        for fact in facts
        if fact[1] == item
        and fact[2] in mistake.scene.objects
        and any(entry.value is True for entry in mistake.trace.history(fact))
    )


def _is_item(mistake: Mistake, name: str) -> bool:
    thing = mistake.scene.objects.get(name)
    return thing is not None and thing.kind is Kind.ITEM


def _near(mistake: Mistake) -> list[int]:
    count = len(mistake.task.subtasks)
    around = [mistake.subtask] if mistake.writer is None else [mistake.subtask, mistake.writer]
    return [index for index in range(count) if any(abs(index - place) <= _SUBTASK_REACH for place in around)]


def _detail_text(part: SimpleTask) -> str:
    return part.detail[0].lower() + part.detail[1:-1]


def _named(mistake: Mistake, index: int) -> str:
    return f"{numbered(index)} {mistake.task.subtasks[index].name}"


def _before(mistake: Mistake, place: int) -> str:
    count = len(mistake.task.subtasks)
    if place < count:
        return f"before {numbered(place)}"
    return "at the end" if count else "as the only subtask"


def opening(fixture: str) -> SimpleTask:
    """Return the subtask that opens a fixture."""
    shut = bddl.Not(bddl.Atom("open", (fixture,)))
    return SimpleTask(f"open_{fixture}", f"Open {fixture}.", fixture, None, None, shut, shut.body, _flow(OPEN))


def closing(fixture: str) -> SimpleTask:
    """Return the subtask that closes a fixture."""
    ajar = bddl.Atom("open", (fixture,))
    return SimpleTask(f"close_{fixture}", f"Close {fixture}.", fixture, None, None, ajar, bddl.Not(ajar), _flow(CLOSE))


def picking(item: str, place: Placement | None) -> SimpleTask:
    """Return the subtask that picks an item up from a place, or from wherever it is."""
    name, detail = f"pick_up_{item}", f"Pick up {item}."
    if place is None:
        held = bddl.Atom("inside", (item, GRIPPER))
        return SimpleTask(name, detail, item, None, None, bddl.Not(held), held, _flow(PICK))
    there = bddl.Atom(place.relation, (item, place.support))
    flow = _flow(TAKE_OUT if place.relation == "inside" else PICK)
    return SimpleTask(name, detail, item, place.support, None, there, bddl.Not(there), flow)


def placing(item: str, place: Placement) -> SimpleTask:
    """Return the subtask that puts an item, which the hand holds, where it belongs."""
    held, there = bddl.Atom("inside", (item, GRIPPER)), bddl.Atom(place.relation, (item, place.support))
    words = f"put {item} {'on' if place.relation == 'ontop' else 'inside'} {place.support}"
    name, detail = words.replace(" ", "_"), f"P{words[1:]}."
    return SimpleTask(name, detail, item, None, place.support, held, there, _flow(PLACE))


def _flow(template: PrimitiveFlow) -> ActionFlow:
    return tuple(map(Action, template))
