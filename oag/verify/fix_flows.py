"""Candidates for fixes of well-formed plans that change one flow.

A step is inserted, left out, replaced or moved, or the whole flow is searched again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isqrt
from typing import NamedTuple

from oag.flows import (
    PlanSearch,
    PrimitiveFlow,
    TooManyStates,
    flows,
    force_flow,
    run_flow,
)
from oag.model.actions import Action, ActionFlow
from oag.model.domain import own_of
from oag.model.symbols import (
    EEF,
    HAND,
    NEAR,
    Primitive,
)
from oag.primitives.state import View, assume_true
from oag.primitives.table import NAVIGATION
from oag.verify.edits import (
    SetFlow,
    inserted,
    move_item,
)
from oag.verify.fix_candidates import Candidate, Cost, Mistake, numbered

# Primitives with symbolic effects. Purely geometric moves are equivalent to each other, and none is ever missing.
_SYMBOLIC = (
    Primitive.NAVIGATE_TO_TARGET,
    Primitive.NAVIGATE_TO_SUPPORT,
    Primitive.APPROACH,
    Primitive.CONVERGE,
    Primitive.GRASP,
    Primitive.ARTICULATE_OPEN,
    Primitive.ARTICULATE_CLOSE,
    Primitive.UNGRASP,
    Primitive.LIFT_EEF_UP,
    Primitive.RETREAT,
)
_MOTION = Primitive.MOVE_BASE_FORWARD
# Steps that are followed to rehearse moves within one flow; flows of fewer than 28 steps are changed anywhere.
_MOST_REHEARSED = 100_000
# Subtasks before the place of a mistake that are changed.
_STEP_REACH = 2
# Largest difference of flows in a ranking, in steps.
_MOST_DIFFERENT = 100


class Rehearsal:
    """The plan followed once more on a window of facts, with the state before every subtask kept.

    A changed flow is tried here first, which takes microseconds; only flows that pass are verified.
    """

    def __init__(self, mistake: Mistake) -> None:
        plan = PlanSearch(mistake.task, mistake.scene)
        self.subtasks, self.legal, self.window = plan.subtasks, plan.legal, plan.start.window
        # The state before every subtask, as if everything had held so far.
        self.before: list[View] = []
        state = plan.start
        for subtask in self.subtasks:
            self.before.append(assume_true(state, subtask.init))
            state = assume_true(force_flow(self.before[-1], subtask), subtask.goal)

    def passes(self, index: int, flow: ActionFlow, *, elsewhere: bool) -> bool:
        """Decide whether a subtask with this flow may reach its goal and let the next one start.

        A flow for a mistake `elsewhere`, which shows in a later subtask, must lead to another state.
        """
        subtask = self.subtasks[index]
        state = run_flow(self.before[index], subtask, flow)
        if state is None or state.truth(subtask.goal) is False:
            return False
        following = self.subtasks[index + 1] if index + 1 < len(self.subtasks) else None
        if elsewhere:
            # What it leaves behind has to differ, poses left out that the next flow brings about itself.
            usual = force_flow(self.before[index], subtask)
            navigates = following is None or bool(following.flow and following.flow[0].primitive in NAVIGATION)
            poses = (NEAR, EEF) if navigates else (EEF,)
            values = zip(self.window.facts, usual.values, state.values, strict=True)
            if not any(before != after for fact, before, after in values if fact not in poses):
                return False
        return following is None or state.truth(following.init) is not False

    def searched(self, index: int) -> PrimitiveFlow | None:
        """Return the first flow that reaches the subtask's goal, or None."""
        try:
            found = flows(self.before[index], self.subtasks[index], self.legal[index])
            return next((each.flow for each in found), None)
        except TooManyStates:
            return None


class _FlowChange(NamedTuple):
    """A changed flow: what was done, at which step, in words."""

    kind: str
    step: int
    words: str
    flow: ActionFlow


def step_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidates that change the flow of the subtask where a mistake shows, or of one shortly before."""
    if mistake.trace is None or not mistake.task.subtasks:
        return
    rehearsal = Rehearsal(mistake)
    for distance, index in enumerate(_subtasks_with_wrong_flow(mistake)):
        flow = mistake.task.subtasks[index].flow
        if flow is None:
            continue
        wanted = rehearsal.searched(index)
        for change in _changes(flow, rehearsal.legal[index], _near_steps(mistake, index, len(flow))):
            if rehearsal.passes(index, change.flow, elsewhere=index != mistake.subtask):
                kind, step, words, changed = change
                edit, text = SetFlow(index, changed, kind, step), words.format(subtask=numbered(index))
                rank = _MOST_DIFFERENT**3 * distance + _difference(changed, flow, wanted)
                yield Candidate(Cost.STEP, kind, text, (edit,), index, step, rank=rank)
        if wanted is not None and wanted != tuple(action.primitive for action in flow):
            searched_flow = tuple(Action(primitive) for primitive in wanted)
            text = " ".join(str(action) for action in searched_flow) or "no steps, since its goal holds already"
            words = f"give {numbered(index)} the flow {text}"
            yield Candidate(Cost.FLOW, "set-flow", words, (SetFlow(index, searched_flow),), index, rank=distance)


def _subtasks_with_wrong_flow(mistake: Mistake) -> tuple[int, ...]:
    """Return the subtasks whose flow may be wrong, the most likely first."""
    last = len(mistake.task.subtasks) - 1
    kind = "" if mistake.obligation is None else mistake.obligation.kind
    here = [mistake.subtask] if kind in ("precondition", "goal") else []
    writer = [] if mistake.writer is None else [mistake.writer]
    if mistake.condition is not None and mistake.condition.fact == HAND:
        # A hand that is full was filled, and not emptied, before.
        here, writer = writer, here
    names = set() if mistake.condition is None else set(mistake.condition.fact[1:])
    latest = min(mistake.subtask, last)
    near = range(latest, max(-1, latest - _STEP_REACH - 1), -1)
    about = [i for i in range(last, -1, -1) if kind == "task-goal" and mistake.task.subtasks[i].target in names]
    return tuple(dict.fromkeys(i for i in (*here, *writer, *about[:2], *near) if i <= latest))


def _near_steps(mistake: Mistake, index: int, length: int) -> range:
    """Return the places in a subtask's flow that are tried: all, but in a very long one those near the mistake.

    Every pair of places is a change to rehearse, and each change is rehearsed over the whole flow.
    """
    reach = isqrt(_MOST_REHEARSED // (length + 1)) // 2
    at = length
    if mistake.obligation is not None and mistake.obligation.subtask == index and mistake.obligation.step >= 0:
        at = mistake.obligation.step
    elif mistake.trace is not None and mistake.entry is not None and mistake.writer == index:
        at = mistake.trace.steps[mistake.entry.time // 2 - 1].position
    return range(max(0, at - reach), min(length, at + reach) + 1)


def _changes(flow: ActionFlow, legal: PrimitiveFlow, places: range) -> Iterator[_FlowChange]:
    primitives = [primitive for primitive in _SYMBOLIC if primitive in legal]
    primitives += [primitive for primitive in legal if own_of(primitive) is not None]
    for step in places:
        for primitive in primitives:
            action = Action(primitive)
            where = f"before step {step + 1} {flow[step].primitive.name}" if step < len(flow) else "at the end"
            words = f"insert {primitive.name} in {{subtask}} {where}"
            yield _FlowChange("insert-step", step, words, inserted(flow, step, action))
    for step, action in zip(places, flow[places.start : places.stop], strict=False):
        name = action.primitive.name
        rest = (*flow[:step], *flow[step + 1 :])
        yield _FlowChange("delete-step", step, f"leave out {{subtask}} step {step + 1} {name}", rest)
        for primitive in primitives:
            if primitive is not action.primitive:
                words = f"replace {{subtask}} step {step + 1} {name} by {primitive.name}"
                yield _FlowChange("replace-step", step, words, inserted(rest, step, Action(primitive)))
        if action.parameter is not None:
            words = f"leave the number of {{subtask}} step {step + 1} {name} to the executor"
            yield _FlowChange("replace-step", step, words, inserted(rest, step, Action(action.primitive)))
        for to in range(places.start, min(len(flow), places.stop)):
            if to not in (step, step - 1):
                words = f"move {{subtask}} step {step + 1} {name} to place {to + 1}"
                yield _FlowChange("move-step", step, words, move_item(flow, step, to))


def _difference(flow: ActionFlow, given: ActionFlow, wanted: PrimitiveFlow | None) -> int:
    """Return the rank of a changed flow: symbolic steps from the right flow, then from the given one, then all steps.

    The last one puts a release after the motions that lead there.
    """
    if wanted is None:
        return 0
    changed, old = [action.primitive for action in flow], [action.primitive for action in given]
    # One motion is as good as another.
    changed, old, right = ([p if p in _SYMBOLIC else _MOTION for p in steps] for steps in (changed, old, wanted))
    symbolic = _edits([p for p in changed if p in _SYMBOLIC], [p for p in right if p in _SYMBOLIC])
    rank = 0
    for difference in (symbolic, _edits(changed, old), _edits(changed, right)):
        rank = rank * _MOST_DIFFERENT + min(difference, _MOST_DIFFERENT - 1)
    return rank


def _edits(left: Sequence[Primitive], right: Sequence[Primitive]) -> int:
    """Return the number of insertions and deletions between two flows."""
    row = list(range(len(right) + 1))
    for count, primitive in enumerate(left, 1):
        above, row = row, [count]
        for position, other in enumerate(right):
            same = above[position] if primitive == other else len(left) + len(right)
            row.append(min(same, above[position + 1] + 1, row[position] + 1))
    return row[-1]
