"""Repairs: other plans for what a subtask failed at, by the reason of the failure.

A failed subtask leaves facts: what is in the way, that no place was found with this grasp, which door was opened for
it. Each repair of the table makes plans of them, the likeliest first. The graph proves a repaired plan again before
anything of it runs.

Another grasp: the hand keeps its pitch from taking to putting. What stands among others may allow steep hands only, and
a low compartment level ones only; on a free top both work. Two more subtasks set the item down and take it again.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace

import numpy as np

import bddl
from executor.assets.library import asset_for
from executor.records import Detour, FailureKind, SubtaskRecord
from oag import Action, Primitive, Scene, SceneObject, SimpleTask, Task
from oag.flows import OPEN, PLACE, taking
from oag.measurements import JointMotion, SupportDrive, TargetDrive, Unplanned, first_of
from oag.model.actions import ActionFlow
from oag.model.infeasible import Infeasible, InfeasibleKind
from oag.model.symbols import GRIPPER, Kind
from oag.primitives.cargo import RESTING
from oag.primitives.table import placement_of

MORE = 2
"""How many subtasks are inserted: a thing is set down and taken again, or taken and set down elsewhere."""

MOST_SUPPORTS = 2
"""On how many supports a thing is set down, one after the other, before the plan is left as it was."""

MOST_BLOCKERS = 2  # Of those that are named, the most frequent first.

WIDER_FRACTIONS, WIDER_BY = (0.92, 0.8), 0.05
"""How far a door in the way is opened, as fractions of its range, short of its stop; by how much more than before."""

Ways = frozenset[tuple[str, str]]
"""Ids of articulated objects, each with a joint that is not to be opened."""


@dataclass(frozen=True, slots=True)
class Failed:
    """A subtask that failed, with what led to it.

    Attributes:
        task: The plan.
        index: Index of the subtask.
        record: What it did.
        scene: The concrete scene.
        held: Id of the item in the gripper at its start, or None.
        before: The records of the subtasks before it.
        avoided: Joints that are not to be opened.
    """

    task: Task
    index: int
    record: SubtaskRecord
    scene: Scene
    held: str | None
    before: tuple[SubtaskRecord, ...] = ()
    avoided: Ways = frozenset()

    @property
    def subtask(self) -> SimpleTask:
        """The subtask."""
        return self.task.subtasks[self.index]


@dataclass(frozen=True, slots=True)
class Repair:
    """Another plan.

    Attributes:
        task: The plan; what comes before `first` is as it was.
        first: Index of the subtask from which it is gone through again.
        last: Index in it of the subtask that had failed.
        detour: What was inserted, and why.
        avoided: Joints that are not to be opened.
    """

    task: Task
    first: int
    last: int
    detour: Detour
    avoided: Ways


def found_no_place(record: SubtaskRecord, subtask: SimpleTask, held: str | None) -> bool:
    """Return whether a held item could not be put anywhere in its place, whatever the open numbers.

    Args:
        held: Id of the item in the gripper at the start.
    """
    chosen_here = any(action.unfilled for action in subtask.flow or ())
    if record.succeeded or held != subtask.target or subtask.support_goal is None or not chosen_here:
        return False
    drives = (first_of(step.measurements, SupportDrive) for step in record.steps)
    return any(drive is not None and drive.nominal for drive in drives)


def regrasps(task: Task, index: int, scene: Scene) -> Iterator[tuple[str, Task]]:
    """Yield tasks in which an item is set down and taken again before it is put where a subtask wants it.

    Args:
        index: Index of the subtask that found no place.

    Returns:
        Ids of supports, first the one that it stood on, then the nearest ones to that, each with its task.
    """
    place = task.subtasks[index]
    taken = [s for s in task.subtasks[:index] if s.target == place.target and s.support_init in scene.objects]
    if not taken:
        return
    for support in _tops_near(scene, str(taken[-1].support_init), place.support_goal):
        more = (_set_down(place.target, support), _taken_again(place.target, scene[support]))
        yield support, _with(task, index, *more)


def impossible(failed: Failed, facts: Collection[str]) -> Infeasible | None:
    """Return what a failed subtask shows to be impossible while all that its search met stays where it is.

    None where the search was not free to choose, ran out of its time, or did not fail for want of a stance, a grasp, a
    place or a way.

    Args:
        facts: What is known to be true at the subtask's start, as BDDL.
    """
    failure, subtask, flow = failed.record.failure, failed.subtask, failed.subtask.flow or ()
    found = first_of(failure.measurements, Unplanned) if failure is not None else None
    if failure is None or found is None or any(action.parameter is not None for action in flow):
        return None
    if failure.kind is FailureKind.NO_ANSWER:
        return None
    kind, place = _attempted(failed, found)
    about = {subtask.target, place}
    # What a part or a spot does not allow, its thing may.
    if kind is None or any(each.where is not None and each.target in about for each in failed.task.subtasks):
        return None
    true = [atom for text in facts if isinstance(atom := failed.scene.domain.formula(text), bddl.Atom)]
    resting = [atom for atom in true if atom.predicate in RESTING and atom.args[1] != GRIPPER]
    moved = {subtask.target} if kind == "take" else set()
    others = {*_met(found), *((place,) if place is not None else ())} & failed.scene.objects.keys() - {subtask.target}
    given: list[bddl.Formula] = [atom for atom in resting if atom.args[0] in others | moved or atom.args[1] == place]
    for name in sorted(others):
        if failed.scene[name].kind is Kind.ARTICULATED:
            is_open = bddl.Atom("open", (name,))
            given.append(is_open if is_open in true else bddl.Not(is_open))
    mentioned = tuple(each for each in given if subtask.target not in _names(each) or kind == "take")
    return Infeasible(kind, subtask.target, place, mentioned, subtask.name, failure.message)


def _attempted(failed: Failed, found: Unplanned) -> tuple[InfeasibleKind | None, str | None]:
    """Return what a failed subtask was about to do, with the place for what it takes or holds."""
    subtask = failed.subtask
    primitives = [action.primitive for action in subtask.flow or ()]
    if failed.scene[subtask.target].kind is not Kind.ITEM:
        opens, closes = (each in primitives for each in (Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE))
        return ("open" if opens else "close" if closes else None), None
    step = next((index for index, step in enumerate(failed.record.steps) if step.failure), 0)
    if found.support is None and Primitive.GRASP in primitives[step:]:
        return "take", None
    # A grasp is chosen for where the thing is put afterwards.
    for each in failed.task.subtasks[failed.index :]:
        placement = placement_of(each.goal, subtask.target) if each.target == subtask.target else None
        if placement is not None:
            return ("ontop" if placement.relation == "ontop" else "inside"), placement.support
    return None, None


def _names(literal: bddl.Formula) -> set[str]:
    return {name for atom in bddl.atoms(literal) for name in atom.args}


def another_door(failed: Failed) -> Iterator[Repair]:
    """Yield the plan in which another door or drawer of the support is opened, where what was opened has no place."""
    if not found_no_place(failed.record, failed.subtask, failed.held):
        return
    support = failed.subtask.support_goal
    for index in range(failed.index - 1, -1, -1):
        opened = failed.task.subtasks[index]
        if opened.target != support or not any(a.primitive is Primitive.ARTICULATE_OPEN for a in opened.flow or ()):
            continue
        motions = (first_of(step.measurements, JointMotion) for step in failed.before[index].steps)
        joints = {motion.joint for motion in motions if motion is not None}
        avoided = failed.avoided | {(support, joint) for joint in joints}
        if any((support, handle.joint) not in avoided for handle in asset_for(failed.scene[support]).handles):
            reason = f"{failed.subtask.target} finds no place behind {' and '.join(sorted(joints))} of {support}"
            yield Repair(failed.task, index, failed.index, Detour(index, 0, reason), avoided)
        return


def another_grasp(failed: Failed) -> Iterator[Repair]:
    """Yield plans in which the item is set down and taken again, where no place can be got to with its grasp."""
    if found_no_place(failed.record, failed.subtask, failed.held):
        item = failed.subtask.target
        for support, task in regrasps(failed.task, failed.index, failed.scene):
            yield _inserting(
                failed, task, MORE, f"no place can be got to with this grasp: {item} is taken again from {support}"
            )


def another_order(failed: Failed) -> Iterator[Repair]:
    """Yield plans in which what is in the way is handled first, where the plan handles it later all the same.

    So is what stands where a held thing has no place, and is taken from there later, as in an exchange.
    """
    index, subtasks = _with_empty_hand(failed), failed.task.subtasks
    for blocker in dict.fromkeys((*_blockers(failed), *_leaving(failed))):
        start = next((k for k in range(failed.index + 1, len(subtasks)) if subtasks[k].target == blocker), None)
        if start is None:
            continue
        end = next((k for k in range(start, len(subtasks)) if subtasks[k].target != blocker), len(subtasks))
        run = subtasks[start:end]
        rest = (*subtasks[index:start], *subtasks[end:])
        task = replace(failed.task, subtasks=(*subtasks[:index], *run, *rest))
        reason = f"{blocker} is in the way of {failed.subtask.target}, and is handled first"
        yield Repair(task, index, failed.index + len(run), Detour(index, 0, reason), failed.avoided)


def moved_aside(failed: Failed) -> Iterator[Repair]:
    """Yield plans in which what is in the way is set down elsewhere first, on its own support or a near one.

    What is in the way of a thing in the hand is moved before that is taken; out of a compartment it goes onto a top.
    """
    first = _with_empty_hand(failed)
    for blocker in _blockers(failed):
        rests = _rests(failed, blocker, first)
        if rests is None:
            continue
        relation, under = rests.predicate, rests.args[1]
        for support in _tops_near(failed.scene, under, under if relation == "inside" else None):
            flow = _flow(taking(relation, failed.scene[under].category))
            detail = f"Take {blocker}, which is in the way of {failed.subtask.target}."
            take = SimpleTask(f"take_{blocker}_away", detail, blocker, under, None, rests, bddl.Not(rests), flow)
            task = _with(failed.task, first, take, _set_down(blocker, support))
            reason = f"{blocker} is in the way of {failed.subtask.target}, and is set down elsewhere on {support}"
            yield Repair(task, first, failed.index + MORE, Detour(first, MORE, reason), failed.avoided)


def opened_wider(failed: Failed) -> Iterator[Repair]:
    """Yield plans in which a door that is in the way of what is done behind it is opened wider, or again."""
    for name in _doors(failed):
        reason = f"the door of {name} is in the way of {failed.subtask.target}, and is opened wider"
        opening = next((k for k in range(failed.index - 1, -1, -1) if _opens(failed.task.subtasks[k], name)), None)
        if opening is None:
            first = _with_empty_hand(failed)
            is_open, flow = bddl.Atom("open", (name,)), _flow(OPEN)
            more = SimpleTask(f"open_{name}_wider", f"Open {name} wider.", name, None, None, is_open, is_open, flow)
            task = _with(failed.task, first, more)
            yield Repair(task, first, failed.index + 1, Detour(first, 1, reason), failed.avoided)
            continue
        found = (first_of(step.measurements, JointMotion) for step in failed.before[opening].steps)
        motions = [motion for motion in found if motion is not None]
        if motions and not {motion.joint for motion in motions} & _joints_met(failed, name):
            continue  # Another door of it is in the way: this one does not move that.
        reached = max((motion.fraction_reached for motion in motions), default=0.0)
        for wider in (fraction for fraction in WIDER_FRACTIONS if fraction > reached + WIDER_BY):
            task = _opening_to(failed.task, opening, wider)
            yield Repair(task, opening, failed.index, Detour(opening, 0, reason), failed.avoided)


REPAIRS: tuple[Callable[[Failed], Iterator[Repair]], ...] = (
    opened_wider,
    another_door,
    another_grasp,
    another_order,
    moved_aside,
)


def _preferred(failed: Failed) -> list[Callable[[Failed], Iterator[Repair]]]:
    """Return all repairs, first those that the plan itself speaks for.

    What the place is free of later is moved first. A hand that was known not to suit the place takes the thing again.
    """
    takes = [record for record in failed.before if failed.task.subtasks[record.index].target == failed.subtask.target]
    drives = [first_of(step.measurements, TargetDrive) for record in takes[-1:] for step in record.steps]
    first: list[Callable[[Failed], Iterator[Repair]]] = [another_order] if _leaving(failed) else []
    if any(drive is not None and drive.suits_place is False for drive in drives):
        first.append(another_grasp)
    return [*first, *(each for each in REPAIRS if each not in first)]


def repairs(failed: Failed) -> Iterator[Repair]:
    """Yield the plans of all repairs that the reason of a failure admits, the smallest change first."""
    for repair in _preferred(failed):
        yield from repair(failed)


def _blockers(failed: Failed) -> list[str]:
    """Return the items in the way, the most frequent first; bodies are named "id/link"."""
    failure = failed.record.failure
    found = first_of(failure.measurements, Unplanned) if failure is not None else None
    items = (name for name in _met(found) if name in failed.scene.objects and failed.scene[name].role == "B")
    return [name for name in dict.fromkeys(items) if name != failed.subtask.target][:MOST_BLOCKERS]


def _leaving(failed: Failed) -> list[str]:
    """Return the items that are taken later from where a held thing found no place."""
    if not found_no_place(failed.record, failed.subtask, failed.held):
        return []
    later, place = failed.task.subtasks[failed.index + 1 :], failed.subtask.support_goal
    return [one.target for one in later if one.support_init == place and one.target != failed.held]


def _met(found: Unplanned | None) -> list[str]:
    """Return the owners of the bodies in the way."""
    return [part.partition("/")[0] for pair in (found.in_the_way or () if found else ()) for part in pair.split()]


def _doors(failed: Failed) -> list[str]:
    """Return the fixtures that a subtask reaches into and whose door is in its way, the most frequent first."""
    subtask, failure = failed.subtask, failed.record.failure
    found = first_of(failure.measurements, Unplanned) if failure is not None else None
    known = [fact for fact in failed.scene.facts if isinstance(fact, bddl.Atom)]
    within = {fact.args[1] for fact in known if fact.predicate == "inside" and fact.args[0] == subtask.target}
    within |= {str(subtask.support_goal), str(subtask.support_init)} & failed.scene.objects.keys()
    pairs = list(found.in_the_way or ())[:MOST_BLOCKERS] if found is not None else []
    bodies = [part.partition("/") for pair in pairs for part in pair.split()]
    return list(
        dict.fromkeys(
            name
            for name, _, link in bodies
            if name in within and any(handle.link == link for handle in asset_for(failed.scene[name]).handles)
        )
    )


def _joints_met(failed: Failed, name: str) -> set[str]:
    """Return the joints of a fixture whose doors or drawers are in the way."""
    failure = failed.record.failure
    found = first_of(failure.measurements, Unplanned) if failure is not None else None
    met = {part for pair in (found.in_the_way or () if found else ()) for part in pair.split()}
    return {handle.joint for handle in asset_for(failed.scene[name]).handles if f"{name}/{handle.link}" in met}


def _opens(subtask: SimpleTask, name: str) -> bool:
    """Return whether a subtask opens a fixture as far as the planner chooses."""
    opening = [action for action in subtask.flow or () if action.primitive is Primitive.ARTICULATE_OPEN]
    return subtask.target == name and any(action.parameter is None for action in opening)


def _opening_to(task: Task, index: int, fraction: float) -> Task:
    """Return the task in which a subtask opens to a fraction of the joint's range."""
    subtask = task.subtasks[index]
    flow = tuple(
        replace(action, parameter=(0.0, fraction)) if action.primitive is Primitive.ARTICULATE_OPEN else action
        for action in subtask.flow or ()
    )
    return replace(task, subtasks=(*task.subtasks[:index], replace(subtask, flow=flow), *task.subtasks[index + 1 :]))


def _with_empty_hand(failed: Failed) -> int:
    """Return the index of the subtask that takes what is held where the failed one begins; else of the failed one."""
    index = failed.index
    while failed.held is not None and index and failed.task.subtasks[index - 1].target == failed.held:
        index -= 1
    return index


def _rests(failed: Failed, item: str, index: int) -> bddl.Atom | None:
    """Return what an item rests on or in at a subtask's start, by the scene's facts and the plan; None if unknown."""
    known = [fact for fact in failed.scene.facts if isinstance(fact, bddl.Atom) and fact.args[0] == item]
    rests = next((fact for fact in known if fact.predicate in RESTING), None)
    for subtask in failed.task.subtasks[:index]:
        if subtask.target == item:
            ends = (atom for atom in bddl.atoms(subtask.goal) if atom.args == (item, subtask.support_goal))
            rests = next((atom for atom in ends if atom.predicate in RESTING), None)
    return rests if rests is not None and rests.args[1] in failed.scene.objects else None


def _tops_near(scene: Scene, first: str, but: str | None) -> list[str]:
    """Return supports with a top: the given one, then the nearest ones to it."""
    here = np.array(scene[first].position)
    far_m = {
        name: float(np.linalg.norm(np.array(thing.position) - here))
        for name, thing in scene.objects.items()
        if name != but and thing.role == "A" and _has_a_top(scene, name)
    }
    return sorted(far_m, key=lambda name: (far_m[name], name))[:MOST_SUPPORTS]


def _has_a_top(scene: Scene, name: str) -> bool:
    return any(region.kind == "surface" for region in asset_for(scene[name]).regions)


def _with(task: Task, index: int, *more: SimpleTask) -> Task:
    return replace(task, subtasks=(*task.subtasks[:index], *more, *task.subtasks[index:]))


def _inserting(failed: Failed, task: Task, count: int, reason: str) -> Repair:
    index = failed.index
    return Repair(task, index, index + count, Detour(index, count, reason), failed.avoided)


def _set_down(item: str, support: str) -> SimpleTask:
    held, on = bddl.Atom("inside", (item, GRIPPER)), bddl.Atom("ontop", (item, support))
    detail = f"Set {item} down on {support}, where it can be taken otherwise."
    return SimpleTask(f"set_{item}_down", detail, item, None, support, held, on, _flow(PLACE))


def _taken_again(item: str, support: SceneObject) -> SimpleTask:
    on = bddl.Atom("ontop", (item, support.id))
    detail = f"Take {item} again, as it can be put where it goes."
    flow = _flow(taking("ontop", support.category))
    return SimpleTask(f"take_{item}_again", detail, item, support.id, None, on, bddl.Not(on), flow)


def _flow(primitives: tuple[Primitive, ...]) -> ActionFlow:
    return tuple(Action(primitive) for primitive in primitives)
