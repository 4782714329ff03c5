"""Search for action flows: of one subtask, of all subtasks that lack one, and the proof that none exists.

The search tries the known templates first, then goes breadth first. A search state is the knowledge of the robot and
of the relevant facts (`View`). These are few and have few values, so a subtask reaches few states and the search is
complete. When it ends without a flow, the visited states are closed under all primitives and none meets the goal. That
set is the proof: an inductive set, as in Eriksson, Roeger and Helmert, Unsolvability Certificates for Classical
Planning (ICAPS 2017).

Missing flows are chosen so that the rest of the plan can still go through.

Source: docs/semantics.md, Searched flows; the paper's primitive completeness assumes that a flow exists.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import NamedTuple

import bddl
from bddl.ast import Quantified
from bddl.terminal import pluralize
from oag.compilation import CompiledSubtask, compile_plan, facts_read, usable
from oag.model.actions import Action, ActionFlow
from oag.model.codec import short_repr
from oag.model.diagnostics import Diagnostic
from oag.model.scene import Scene
from oag.model.symbols import (
    EEF,
    GRIPPER,
    HAND,
    NEAR,
    Fact,
    Parameter,
    Primitive,
    applicable,
    fact_text,
    has_boards,
    held_by,
)
from oag.primitives.cargo import RESTING
from oag.primitives.state import View, Window, assume_true, contradictions, facts_of, start_state, step, truth_of
from oag.primitives.table import NAVIGATION, Needed, needed, placement_of
from oag.progression import Trace
from oag.task_definition import SimpleTask, Task, chosen_scene, subtask_place
from oag.wellformed import check

# The flows that simple tasks have, their numbers open, by the paper's table of initial action flows. Departures: every
# flow begins with a navigation, every release ends with a retreat, the hand is moved down at the end of every placing,
# and it backs out of what it has taken a thing out of (docs/departures.md).
_REACH = (Primitive.NAVIGATE_TO_TARGET, Primitive.APPROACH, Primitive.CONVERGE, Primitive.GRASP)
_RELEASE = (Primitive.UNGRASP, Primitive.RETREAT)

OPEN = (*_REACH, Primitive.ARTICULATE_OPEN, *_RELEASE)
CLOSE = (*_REACH, Primitive.ARTICULATE_CLOSE, *_RELEASE)
PICK = (*_REACH, Primitive.LIFT_EEF_UP)
# Within a compartment, or under a shelf's next board, a lift takes nothing out: the hand has to back out with it.
TAKE_OUT = (*PICK, Primitive.RETREAT)
PLACE = (Primitive.NAVIGATE_TO_SUPPORT, Primitive.MOVE_BASE_FORWARD, Primitive.LIFT_EEF_DOWN, *_RELEASE)
# Nothing is grasped: the hand goes down behind a thing and presses it on, beside another one.
PUSH = (
    Primitive.NAVIGATE_TO_TARGET,
    Primitive.APPROACH,
    Primitive.CONVERGE,
    Primitive.MOVE_EEF_FORWARD,
    Primitive.RETREAT,
)
# Picking up and putting down in one subtask; shorter flows do without the lift, which only the symbols allow.
TRANSPORT = (*PICK, *PLACE)


TEMPLATES = (OPEN, CLOSE, PICK, TAKE_OUT, PLACE, TRANSPORT)

# More states than any subtask of a real scene reaches; beyond it the search gives up without a claim.
MOST_STATES = 20_000
# Of flows equally long, the first in this order is taken: go there, reach, act, let go, move away.
ORDER = (17, 18, 1, 2, 3, 4, 19, 5, 7, 6, 8, 9, 10, 11, 12, 13, 14, 15, 16, 20, 21)

PrimitiveFlow = tuple[Primitive, ...]
# Returns the state after a primitive, None when it may not run.
_Step = Callable[[View, CompiledSubtask, Primitive, Parameter], View | None]


def taking(relation: str, category: str) -> PrimitiveFlow:
    """Return the flow that takes a thing from where it is: "ontop" or "inside" something of a category."""
    return TAKE_OUT if relation == "inside" or has_boards(category) else PICK


class Found(NamedTuple):
    """A flow and what is known after it."""

    flow: PrimitiveFlow
    state: View


class TooManyStates(Exception):
    """A search gave up before it was complete."""


class Leave(IntEnum):
    """How much a flow may leave open; open needs are assumed, goals only as the last resort."""

    NOTHING = 0
    PRECONDITIONS = 1
    GOALS = 2


def legal_primitives(subtask: SimpleTask, scene: Scene) -> PrimitiveFlow:
    """Return the primitives that a well-formed flow of a subtask may use, in the order of preference."""
    kind, domain = scene.objects[subtask.target].kind, scene.domain
    return tuple(
        primitive
        for primitive in (map(Primitive, ORDER) if domain.inherits else ())
        if applicable(primitive, kind) and not (primitive is NAVIGATION[1] and subtask.support_goal is None)
    ) + usable(subtask, scene)


def flows(start: View, subtask: CompiledSubtask, legal: PrimitiveFlow, leave: Leave = Leave.NOTHING) -> Iterator[Found]:
    """Yield flows that take a subtask from a state to its goal, with what is known after each.

    Args:
        start: What is known where the subtask starts.
        subtask: Its objects and its goal.
        legal: The primitives that a flow may use, from `legal_primitives`.
        leave: How much may stay unknown: nothing, preconditions, or parts of the goal as well.

    Yields:
        One flow for each state in which the goal may hold. Flows that leave least open come first, as `Leave` orders
        them; of open goals those with the fewest open parts. Among equals comes the empty flow when the goal holds
        already, then working templates in the order of `TEMPLATES`, then the shortest.

    Raises TooManyStates after what was found within `MOST_STATES` states.
    """
    visited: set[View] = set()
    gave_up = False
    for level in Leave:
        if level > leave:
            break
        try:
            for found in _leaving(start, subtask, legal, level):
                if found.state not in visited:
                    visited.add(found.state)
                    yield found
        except TooManyStates:
            gave_up = True
    if gave_up:
        raise TooManyStates


def _leaving(start: View, subtask: CompiledSubtask, legal: PrimitiveFlow, level: Leave) -> Iterator[Found]:
    """Yield the flows that leave at most as much open as a level allows."""
    goal = subtask.goal
    if level is not Leave.GOALS:
        taken = _known_step if level is Leave.NOTHING else _assumed_step
        yield from (found for found in _tried(start, subtask, legal, taken) if found.state.truth(goal) is True)
        return
    opened = [
        found
        for taken in (_known_step, _assumed_step)
        for found in _tried(start, subtask, legal, taken)
        if found.state.truth(goal) is None
    ]
    # Sorting keeps the order among equals, so known preconditions, templates and short flows come first.
    yield from sorted(opened, key=lambda found: _open_parts(found.state, goal))
    # Of several unknown alternatives the first was assumed above; another may be the one that helps.
    yield from (
        found for found in _tried(start, subtask, legal, _possible_step) if found.state.truth(goal) is not False
    )


def _open_parts(state: View, wanted: Needed) -> int:
    parts = [(clause,) for clause in wanted] if isinstance(wanted, tuple) else bddl.conjuncts(wanted)
    return sum(state.truth(part) is None for part in parts)


def _tried(start: View, subtask: CompiledSubtask, legal: PrimitiveFlow, taken: _Step) -> Iterator[Found]:
    """Yield the empty flow and the templates that can run, then a shortest flow to every reachable state."""
    if subtask.context.placement is None and HAND not in facts_of(subtask.goal, start.window.objects):
        taken = _holding_on(taken)
    for flow in ((), *TEMPLATES):
        end: View | None = start
        for primitive in flow:
            end = taken(end, subtask, primitive, None) if end is not None and primitive in legal else None
        if end is not None:
            yield Found(flow, end)
    yield from _breadth_first(start, subtask, legal, taken)


def _holding_on(taken: _Step) -> _Step:
    """Return a step that never drops the target, for a goal that mentions neither its place nor the hand."""

    def held(state: View, subtask: CompiledSubtask, primitive: Primitive, parameter: Parameter) -> View | None:
        falls = primitive is Primitive.UNGRASP and held_by(state.hand) == subtask.context.target
        return None if falls else taken(state, subtask, primitive, parameter)

    return held


def _may_run(state: View, subtask: CompiledSubtask, primitive: Primitive, parameter: Parameter) -> bool | None:
    return truth_of(subtask.rows.row(primitive, state.hand, parameter)[0], state.value, {})


def _known_step(state: View, subtask: CompiledSubtask, primitive: Primitive, parameter: Parameter) -> View | None:
    known = _may_run(state, subtask, primitive, parameter) is True
    return step(state, subtask.rows, primitive, parameter)[1] if known else None


def _possible_step(state: View, subtask: CompiledSubtask, primitive: Primitive, parameter: Parameter) -> View | None:
    """Return what is known after a primitive that may run, whichever alternative held; otherwise None."""
    impossible = _may_run(state, subtask, primitive, parameter) is False
    return None if impossible else step(state, subtask.rows, primitive, parameter)[1]


def _assumed_step(state: View, subtask: CompiledSubtask, primitive: Primitive, parameter: Parameter) -> View | None:
    """Return the state after a primitive that may run, with its needs assumed; otherwise None."""
    impossible = _may_run(state, subtask, primitive, parameter) is False
    return None if impossible else _forced_step(state, subtask, primitive, parameter)


def _forced_step(state: View, subtask: CompiledSubtask, primitive: Primitive, parameter: Parameter) -> View:
    """Return what is known after a primitive, as if all its needs had held."""
    state = assume_true(state, subtask.rows.row(primitive, state.hand, parameter)[0])
    return step(state, subtask.rows, primitive, parameter)[1]


def run_flow(state: View, subtask: CompiledSubtask, flow: ActionFlow | None = None) -> View | None:
    """Return what is known after a flow, by default the subtask's own; None when it cannot run."""
    for action in subtask.flow or () if flow is None else flow:
        after = _possible_step(state, subtask, action.primitive, action.parameter)
        if after is None:
            return None
        state = after
    return state


def force_flow(state: View, subtask: CompiledSubtask) -> View:
    """Return what is known after a subtask's own flow, as if every precondition had held."""
    for action in subtask.flow or ():
        state = _forced_step(state, subtask, action.primitive, action.parameter)
    return state


def reachable(start: View, subtask: CompiledSubtask, legal: PrimitiveFlow) -> tuple[View, ...]:
    """Return every state that any flow of a subtask leads to; unknown preconditions count as met.

    Raises TooManyStates beyond `MOST_STATES`.
    """
    return tuple(found.state for found in _breadth_first(start, subtask, legal, _possible_step))


def _breadth_first(start: View, subtask: CompiledSubtask, legal: PrimitiveFlow, taken: _Step) -> Iterator[Found]:
    visited = {start}
    waiting = deque([Found((), start)])
    yield waiting[0]
    while waiting:
        flow, state = waiting.popleft()
        for primitive in legal:
            after = taken(state, subtask, primitive, None)
            if after is None or after in visited:
                continue
            if len(visited) >= MOST_STATES:
                raise TooManyStates
            visited.add(after)
            waiting.append(Found((*flow, primitive), after))
            yield waiting[-1]


# Most partial plans that a search over all missing flows visits.
MOST_OPTIONS = 5_000


@short_repr
@dataclass(frozen=True, slots=True)
class Completion:
    """A task with the flows that a search could add.

    Attributes:
        searched: Indices of the subtasks whose flow was searched and found.
        missing: Indices of the subtasks that still have none.
    """

    task: Task
    searched: tuple[int, ...]
    missing: tuple[int, ...]


def complete(task: Task, scene: Scene | None = None) -> Completion:
    """Return a task with a flow for every subtask that lacks one and can have one.

    Flows are chosen so that the whole plan succeeds, where that is possible. Otherwise each subtask reaches its goal
    and, if possible, the initial condition of the next one. The first subtask without any flow ends the search, since
    later ones have no start state. Given flows are never changed. A goal with alternatives, such as a disjunction, is
    narrowed to one alternative where only that has a flow. A task that is not well formed is returned as it is.

    The scene is by default the one that the task carries.

    Example:
        >>> import oag
        >>> scene = oag.Scene.from_json({"objects": {"box_0": {"category": "drawer", "bbox_extent": [1, 1, 1]}}})
        >>> opening = {"target": "box_0", "init": "(not (open box_0))", "goal": "(open box_0)"}
        >>> task = oag.Task.from_json({"sub_tasks": [opening]}, scene=scene)
        >>> [action.primitive.name for action in oag.complete(task).task.subtasks[0].flow][:3]
        ['NAVIGATE_TO_TARGET', 'APPROACH', 'CONVERGE']
    """
    return _completed(task, chosen_scene(task, scene), iter(range(MOST_GOAL_OPTIONS)))[0]


def _completed(task: Task, scene: Scene, tries: Iterator[int]) -> tuple[Completion, bool]:
    """Return a task with its missing flows, and whether the whole plan succeeds with them.

    `tries` has one entry for each alternative of a goal that may be tried.
    """
    lacking = tuple(index for index, subtask in enumerate(task.subtasks) if subtask.flow is None)
    if not lacking or check(task, scene):
        return Completion(task, (), lacking), not lacking
    chain = PlanSearch(task, scene)
    through = next(filter(None, (chain.through(leave) for leave in Leave)), None)
    found = through or chain.as_far_as_possible()
    subtasks = list(task.subtasks)
    for index in lacking:
        if index < len(found):
            subtasks[index] = replace(subtasks[index], flow=tuple(map(Action, found[index])))
    done = tuple(index for index in lacking if index < len(found))
    completion = Completion(replace(task, subtasks=tuple(subtasks)), done, lacking[len(done) :])
    if through is not None or not completion.missing:
        return completion, through is not None
    return _with_a_choice(task, scene, completion, tries)


def _with_a_choice(task: Task, scene: Scene, completion: Completion, tries: Iterator[int]) -> tuple[Completion, bool]:
    """Complete the task with an alternative of the goal of the first subtask without a flow.

    The first alternative with which the whole plan succeeds is taken, otherwise the first that gets furthest.
    """
    first, furthest = completion.missing[0], completion
    for option, _ in zip(narrow_goal(task.subtasks[first], scene), tries, strict=False):
        chosen = replace(task, subtasks=(*task.subtasks[:first], option, *task.subtasks[first + 1 :]))
        found, through = _completed(chosen, scene, tries)
        if through:
            return found, True
        if furthest.missing and (not found.missing or found.missing[0] > furthest.missing[0]):
            furthest = found
    return furthest, False


class PlanSearch:
    """The subtasks of a task as one search: given flows are followed, missing ones are tried.

    Attributes:
        subtasks: Prepared for progression.
        start: What is known at the start of the facts that the plan reads.
        legal: The primitives that each subtask's flow may use.
    """

    def __init__(self, task: Task, scene: Scene) -> None:
        objects = scene.categories
        self.subtasks = compile_plan(task.subtasks, scene)
        self.goal: Needed = needed(task.goal)
        window = Window(facts_read(self.subtasks, self.goal, objects), objects)
        self.start: View = window.view(start_state(scene, task.subtasks[0].target))
        self.legal = tuple(legal_primitives(subtask, scene) for subtask in task.subtasks)

    def through(self, leave: Leave) -> list[PrimitiveFlow]:
        """Return flows with which the whole plan succeeds within the allowed unknowns; an empty list if there are none.

        Depth first over the subtasks, each one's flows in the order of `flows`. A state that failed once at a subtask
        is not tried again.
        """
        failed: set[tuple[int, View]] = set()
        chosen: list[Found] = []
        open_options: list[Iterator[Found]] = [self._options(0, self.start, leave)]
        for _ in range(MOST_OPTIONS):
            if not open_options:
                return []
            index = len(open_options) - 1
            try:
                option = next(open_options[-1], None)
            except TooManyStates:
                option = None
            if option is None:
                open_options.pop()
                before = chosen[-1].state if chosen else self.start
                failed.add((index, before))
                del chosen[index - 1 if index else 0 :]
                continue
            if index + 1 == len(self.subtasks):
                if self._may(option.state.truth(self.goal), leave):
                    return [found.flow for found in (*chosen, option)]
                continue
            if (index + 1, option.state) not in failed:
                chosen.append(option)
                open_options.append(self._options(index + 1, option.state, leave))
        return []

    def as_far_as_possible(self) -> list[PrimitiveFlow]:
        """Return flows up to the first subtask without any, whatever fails before it."""
        chosen: list[PrimitiveFlow] = []
        state = self.start
        for index, subtask in enumerate(self.subtasks):
            state = assume_true(state, subtask.init)
            if subtask.flow is None:
                found = self._best(index, state)
                if found is None:
                    return chosen
            else:
                found = Found(tuple(action.primitive for action in subtask.flow), force_flow(state, subtask))
            chosen.append(found.flow)
            state = assume_true(found.state, subtask.goal)
        return chosen

    def _options(self, index: int, state: View, leave: Leave) -> Iterator[Found]:
        """Yield the flows of one subtask from a state, the given one alone where there is one."""
        subtask = self.subtasks[index]
        if state.truth(subtask.init) is False:
            return
        state = assume_true(state, subtask.init)
        if subtask.flow is None:
            yield from flows(state, subtask, self.legal[index], leave)
            return
        end = run_flow(state, subtask)
        if end is not None and end.truth(subtask.goal) is not False:
            yield Found(tuple(action.primitive for action in subtask.flow), end)

    def _best(self, index: int, state: View) -> Found | None:
        following = self.subtasks[index + 1].init if index + 1 < len(self.subtasks) else self.goal
        first: Found | None = None
        for leave in Leave:
            try:
                for found in flows(state, self.subtasks[index], self.legal[index], leave):
                    first = first or found
                    if self._may(found.state.truth(following), leave):
                        return found
            except TooManyStates:
                pass
        return first

    @staticmethod
    def _may(truth: bool | None, leave: Leave) -> bool:
        """Decide whether what follows is acceptable: an open goal only where that is allowed."""
        return truth is True or (truth is None and leave is Leave.GOALS)


# Most alternatives of goals that are tried in one task; nothing is claimed of further ones.
MOST_GOAL_OPTIONS = 64


def narrow_goal(subtask: SimpleTask, scene: Scene) -> Iterator[SimpleTask]:
    """Yield a subtask with one alternative of its goal as its goal, those that change least of the start first.

    Each goal implies the given one in every state; a conjunction of literals has no alternatives. A given goal support
    is kept; a missing one is set to where the alternative puts the target.
    """
    if bddl.literals(subtask.goal) is not None:
        return
    known = start_state(scene, None)
    # The hand's contents are not part of the start.
    atoms = (atom for atom in bddl.ground(subtask.goal, scene.categories).atoms if GRIPPER not in atom.args)
    state = {atom: value for atom in atoms if (value := known.holds(atom)) is not None}
    try:
        for option in bddl.options(subtask.goal, scene.categories, state):
            goal = bddl.And(tuple(literal.formula for literal in option))
            placement = placement_of(goal, subtask.target)
            support = subtask.support_goal if placement is None else placement.support
            if contradictions(option) is None and subtask.support_goal in (None, support):
                yield replace(subtask, goal=goal.parts[0] if len(goal.parts) == 1 else goal, support_goal=support)
    except bddl.SearchLimit:
        return


@short_repr
@dataclass(frozen=True, slots=True)
class NoFlow:
    """The proof that a subtask has no flow.

    Attributes:
        facts: The facts of the states, in order.
        start: What is known where the subtask starts.
        states: States that contain the start and are closed under all primitives; the goal holds in none.
    """

    subtask: int
    facts: tuple[Fact, ...]
    start: View
    states: tuple[View, ...]

    def to_json(self) -> dict[str, object]:
        """Return the proof as JSON values."""
        return {
            "subtask": self.subtask,
            "facts": [list(fact) for fact in self.facts],
            "start": list(self.start.values),
            "states": [list(state.values) for state in self.states],
        }


def prove_no_flow(task: Task, scene: Scene, trace: Trace) -> NoFlow | None:
    """Return the proof that the subtask at which a trace stopped has no flow.

    None when the trace did not stop, a flow may exist, or the search was too large to decide.
    """
    index = trace.undecided_from
    if index is None:
        return None
    subtask = task.subtasks[index]
    compiled, objects = compile_plan(task.subtasks, scene)[index], scene.categories
    window = Window(facts_read((compiled,), compiled.goal, objects), objects)
    start = window.view(trace.state)
    legal = legal_primitives(subtask, scene)
    try:
        states = reachable(start, compiled, legal)
    except TooManyStates:
        return None
    if any(state.truth(compiled.goal) is not False for state in states):
        return None
    return NoFlow(index, window.facts, start, states)


def no_flow_finding(task: Task, trace: Trace, proof: NoFlow | None) -> Iterator[Diagnostic]:
    """Yield the diagnostic of the subtask without a flow at which a trace stopped."""
    index = trace.undecided_from
    if index is None:
        return
    left = len(task.subtasks) - index - 1
    after = f", nor of the {left} after it" if left else ""
    hint: str | None
    if proof is None:
        message = f"it has no action flow, so neither its goal{after} nor the task goal is decided"
        hint = "give it a flow, such as [17, 1, 2, 3], or have one searched with oag.complete"
    else:
        # Poses are left out, which flows bring about themselves.
        known = zip(proof.facts, proof.start.values, strict=True)
        start = [fact_text(fact, value) for fact, value in known if value is not None and fact not in (NEAR, EEF)]
        message = f"no sequence of primitives leads from where it starts to {bddl.format(task.subtasks[index].goal)}"
        message += f"\n{pluralize(len(proof.states), 'state')} can be reached, and the goal holds in none of them"
        message += f"\nit starts with {', '.join(start) or 'nothing known'}"
        hint = no_flow_hint(task.subtasks[index])
    yield Diagnostic(
        "flow/no-flow",
        "warning" if proof is None else "error",
        message,
        subtask_place(task, index),
        index,
        hint=hint,
    )


def searched_notes(task: Task, searched: tuple[int, ...]) -> Iterator[Diagnostic]:
    """Yield one note for each subtask whose flow was searched."""
    for index in searched:
        flow = " ".join(map(str, task.subtasks[index].flow or ())) or "that nothing has to be done"
        goal = bddl.format(task.subtasks[index].goal)
        message = f"it came without a flow, and a search found {flow} for {goal}"
        yield Diagnostic("flow/searched", "note", message, subtask_place(task, index), index)


def no_flow_hint(subtask: SimpleTask) -> str | None:
    """Return what in the form of a goal keeps every flow of a subtask from reaching it; None if nothing does."""
    target, goal = subtask.target, subtask.goal
    wanted = [
        literal.atom
        for part in bddl.conjuncts(goal)
        for literal in bddl.literals(part) or ()
        if literal.value and literal.atom.predicate in RESTING and GRIPPER not in literal.atom.args
    ]
    own = [atom for atom in wanted if atom.args[0] == target]
    others = dict.fromkeys(atom.args[0] for atom in wanted if atom.args[0] != target)
    if len(own) > 1:
        first, second = map(bddl.format, own[:2])
        return f"UNGRASP puts {target} in one place, the first that the goal names: {first} and not {second}; drop one"
    if others:
        named = ", ".join(others)
        return f"a subtask moves its target {target} alone, not {named}: give {named} a subtask of its own"
    resting_atoms = [atom for atom in bddl.atoms(goal) if atom.predicate in RESTING and GRIPPER not in atom.args]
    if not own and resting_atoms:
        bound = {b.variable for node in goal.walk() if isinstance(node, Quantified) for b in node.binders}
        examples = sorted(map(bddl.format, (atom for atom in resting_atoms if bound.isdisjoint(atom.args))))
        return (
            f"the goal leaves a choice where {target} is to be, and no way to meet it was found to have a flow: write "
            f"the one that is meant{f', such as {examples[0]}' if examples else ''}, and see what it lacks"
        )
    return None
