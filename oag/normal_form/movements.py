"""A proved plan as movements: its steps cut anew where the hand is at rest, and what each movement changes.

Source: docs/canonical.md, Movements.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, groupby, pairwise

import bddl
from oag.model.actions import Action, ActionFlow
from oag.model.facts import ANY, EEF, EMPTY, GRIPPER, HAND, NEAR, Fact, Value, generalisations, holding
from oag.model.primitives import (
    ARTICULATIONS,
    MAX_ANGLE_DEG,
    MAX_DISTANCE_M,
    ParameterKind,
    Primitive,
    parameter_kind,
)
from oag.model.scene import RobotPose
from oag.normal_form.formulas import conjunction
from oag.progression.progress import Step, Trace
from oag.table.library import NAVIGATION, RESTING
from oag.table.state import START
from oag.task.sizes import longest_motion_m
from oag.task.task import SimpleTask, Task

_LARGEST = {ParameterKind.DISTANCE_M: MAX_DISTANCE_M, ParameterKind.ANGLE_DEG: MAX_ANGLE_DEG}
# Sums of decimal numbers are rounded to a nanometre, so that 0.1 and 0.2 make 0.3.
_DIGITS = 9
_NAVIGATION = frozenset(NAVIGATION)


@dataclass
class Movement:
    """Steps about one target that belong together, with what they change.

    Attributes:
        subtasks: The subtasks that the steps were in.
        flow: The steps as they are written.
        steps: The steps as they run; the reset's way to the first target is none.
        reads: Facts about the world that the steps need.
        before: Value of every fact or pattern that they write before them, robot's pose left out; hand included.
        after: The same facts after them.
    """

    subtasks: list[SimpleTask]
    flow: list[Action] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    reads: set[Fact] = field(default_factory=set)
    before: dict[Fact, Value] = field(default_factory=dict)
    after: dict[Fact, Value] = field(default_factory=dict)

    @property
    def target(self) -> str:
        """Id of the object that it is about."""
        return self.subtasks[0].target

    @property
    def navigates(self) -> bool:
        """True when it does not depend on where the robot stands."""
        return self.flow[0].primitive in _NAVIGATION

    @property
    def begins_part(self) -> bool:
        """True when the hand is empty before it and where the robot stands is of no account."""
        return self.navigates and self.before[HAND] == EMPTY

    @property
    def carries(self) -> bool:
        """True when its target is in the hand and moves."""
        return any(fact[:2] in _places(self.target) for fact in self.before)

    def does(self, *primitives: Primitive) -> bool:
        """True when one of its steps is one of some primitives."""
        return any(action.primitive in primitives for action in self.flow)

    def written(self) -> SimpleTask:
        """Returns it as a subtask, whose conditions and name say what it changes."""
        target = self.target
        rests = [fact for fact, value in self.before.items() if value is True and fact[:2] in _places(target)]
        held = (("inside", target, GRIPPER),)
        given = held if self.before[HAND] == holding(target) else tuple(rests)
        init, goal = _all(held if given == held else ()), _all(())
        words, support_goal = f"handle {target}", None
        opened = self.after.get(("open", target))
        places = [fact for fact, value in self.after.items() if value is True and fact[:2] in _places(target)]
        placed = places[0] if places and self.does(Primitive.UNGRASP) else None
        if self.does(*ARTICULATIONS) and opened is not None:
            was = self.before["open", target]
            given = () if was is None else (("open", target),)
            init, goal = _all(given, was is True), _all((("open", target),), opened is True)
            words = f"{'open' if opened else 'close'} {target}"
        elif self.after[HAND] == holding(target) != self.before[HAND]:
            left = tuple(fact for fact in rests if self.after[fact] is False)
            init, goal = _all(given), _all(left, False) if left else _all(held)
            words = f"pick up {target}"
        elif placed is not None:
            init, goal, support_goal = _all(given), _all((placed,)), placed[2]
            words = f"put {target} {'inside' if placed[0] == 'inside' else 'on'} {placed[2]}"
        supports = {fact[2] for fact in given if len(fact) == 3}
        planned = all(subtask.flow is not None for subtask in self.subtasks)
        return SimpleTask(
            words.replace(" ", "_"),
            f"{words[0].upper()}{words[1:]}.",
            target,
            next((s.support_init for s in self.subtasks if s.support_init in supports), None),
            self._goes_to() if support_goal is None else support_goal,
            init,
            goal,
            summed_moves(self.flow) if planned else None,
        )

    def _goes_to(self) -> str | None:
        named = (subtask.support_goal for subtask in self.subtasks if subtask.support_goal is not None)
        return next(named, None) if self.does(Primitive.NAVIGATE_TO_SUPPORT) else None


def movements(task: Task, planned: Task, trace: Trace) -> list[Movement]:
    """Returns the movements of a proved plan, without those that change nothing."""
    found = _cut(task, planned, trace)
    covered = _by_pattern(trace)
    state, time = trace.start, START
    for movement in found:
        written: set[Fact] = set()
        movement.before[HAND] = state.hand
        for step in movement.steps:
            for fact, _ in step.effect:
                if fact not in written and fact not in (NEAR, EEF):
                    written.add(fact)
                    # What a pattern stands for beside these has the pattern's own value.
                    for instance in (fact, *covered.get(fact, ())):
                        movement.before.setdefault(instance, state.value(instance))
            time += 2
            state = state.after(step.effect, time)
        movement.after = {fact: state.value(fact) for fact in movement.before}
    if found and found[0].before[HAND] == EMPTY and not found[0].navigates:
        # The reset's own way to the first target, so that the first movement can stand anywhere.
        found[0].flow.insert(0, Action(Primitive.NAVIGATE_TO_TARGET))
    return _without_idle(found)


def _cut(task: Task, planned: Task, trace: Trace) -> list[Movement]:
    """Returns a plan's steps cut into movements; a subtask without steps is none."""
    found: list[Movement] = []
    reads = _reads(trace)
    for number, (step, following) in enumerate(pairwise((*trace.steps, None))):
        if step is None or (following is not None and {step.primitive, following.primitive} <= _NAVIGATION):
            # Driving on at once undoes what the first drive is for, and carries along what it carries.
            continue
        subtask = task.subtasks[step.subtask]
        if not found or _begins(found[-1], subtask, step):
            found.append(Movement([]))
        movement = found[-1]
        if not any(subtask is other for other in movement.subtasks):
            movement.subtasks.append(subtask)
        movement.flow.append((planned.subtasks[step.subtask].flow or ())[step.position])
        movement.steps.append(step)
        movement.reads |= reads.get(number, set())
    return found


def _begins(movement: Movement, subtask: SimpleTask, step: Step) -> bool:
    """Decides whether a step does not go on with a movement: the hand is at rest, or it is about something else."""
    supports = {subtask.support_goal, *(other.support_goal for other in movement.subtasks)} - {None}
    if subtask.target != movement.target or len(supports) > 1:
        return True
    if step.hand == EMPTY and step.primitive is Primitive.APPROACH:
        return movement.does(Primitive.UNGRASP)
    at_rest = step.hand == EMPTY or (step.hand == holding(subtask.target) and movement.does(Primitive.GRASP))
    return at_rest and step.primitive in _NAVIGATION


def _reads(trace: Trace) -> dict[int, set[Fact]]:
    """Returns the facts about the world on which the precondition of each step rests."""
    found: dict[int, set[Fact]] = {}
    for obligation in trace.obligations:
        if obligation.kind == "precondition":
            facts = {link.condition.fact for link in obligation.links if len(link.condition.fact) > 1}
            found.setdefault(obligation.time // 2, set()).update(facts)
    return found


def _by_pattern(trace: Trace) -> dict[Fact, list[Fact]]:
    """Returns the facts that are written by themselves anywhere, by each pattern that stands for them."""
    effects = chain(((fact for fact, _ in trace.start.entries()),), ((f for f, _ in s.effect) for s in trace.steps))
    found: dict[Fact, list[Fact]] = {}
    for fact in dict.fromkeys(fact for effect in effects for fact in effect if ANY not in fact):
        for pattern in generalisations(fact)[1:]:
            found.setdefault(pattern, []).append(fact)
    return found


def _without_idle(found: Sequence[Movement]) -> list[Movement]:
    """Returns the movements without those that change nothing, and without pairs that pick a thing up and put it back.

    What comes after must not depend on where the robot stands.
    """
    kept: list[Movement] = []
    for movement in reversed(found):
        if _is_free(kept) and _is_idle(movement.before, movement.after):
            continue
        kept.append(movement)
        picks_up = movement.after[HAND] == holding(movement.target)
        if picks_up and len(kept) > 1 and kept[-2].target == movement.target and _is_free(kept[:-2]):
            last = kept[-2]
            if _is_idle({**last.before, **movement.before}, {**movement.after, **last.after}):
                del kept[-2:]
    return kept[::-1]


def _is_free(later: Sequence[Movement]) -> bool:
    """True when the first of some later movements, which stands last in the list, navigates first, or there is none."""
    return not later or later[-1].navigates


def _is_idle(before: Mapping[Fact, Value], after: Mapping[Fact, Value]) -> bool:
    return all(after[fact] == value for fact, value in before.items())


def _places(target: str) -> tuple[Fact, ...]:
    return tuple((relation, target) for relation in RESTING)


def _all(facts: Iterable[Fact], value: bool = True) -> bddl.Formula:
    atoms = (bddl.Atom(fact[0], fact[1:]) for fact in facts)
    return conjunction(atom if value else bddl.Not(atom) for atom in atoms)


def summed_moves(flow: Sequence[Action]) -> ActionFlow:
    """Returns a flow in which moves of one kind in a row are one, or, where their sum is too large for one, the fewest.

    Moves whose numbers are still open stay as they are.
    """
    merged: list[Action] = []
    for primitive, group in groupby(flow, key=lambda action: action.primitive):
        # What is merged is no longer than what every robot's hand can do.
        largest = longest_motion_m(primitive, RobotPose()) or _LARGEST.get(parameter_kind(primitive))
        for known, part in groupby(group, key=lambda action: isinstance(action.parameter, int | float)):
            actions = tuple(part)
            if largest is None or not known or len(actions) == 1:
                merged.extend(actions)
                continue
            numbers = (action.parameter for action in actions)
            left = round(math.fsum(number for number in numbers if isinstance(number, int | float)), _DIGITS)
            while left > largest:
                merged.append(Action(primitive, largest))
                left = round(left - largest, _DIGITS)
            merged.append(Action(primitive, left))
    return tuple(merged)
