"""Whether the cause of a failure lies in an earlier subtask, which was reached at the time.

An item that was taken beside its middle slips when it is carried; a door that was opened by a little lets no hand
in; an item that stands too near to the front keeps a door from closing. What was measured at the time says so.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from llm.evolution.cause import CauseKind, RootCause, cause_at
from oag import Attempt, History, Primitive, Task
from oag.revision.measurements import GripMeasured

TAKEN_BESIDE_M = 0.006
"""From here on an item counts as taken badly, which is then looked at before anything else."""

LEANING_DEG = 10.0
"""From here on what leans between the fingers may be why it can be put down nowhere."""

WEAK_N = 10.0
"""Below this a finger presses less than a sound gripper does by far."""

WIDE_ENOUGH = 0.6
"""A door that is open by this fraction of its range is not what keeps the robot out."""

# An item that hangs askew in the hand fits nowhere, and is let go beside its place.
_HELD = frozenset({CauseKind.GRIP_LOST, CauseKind.NOWHERE, CauseKind.MISPLACED})
_KEPT_OUT = frozenset(
    {CauseKind.BLOCKED, CauseKind.NOWHERE, CauseKind.NO_WAY, CauseKind.OUT_OF_REACH, CauseKind.DISPLACED}
)


@dataclass(frozen=True, slots=True)
class EarlierCause:
    """A step of an earlier subtask that may be to blame.

    Attributes:
        subtask: Index of the earlier subtask.
        cause: The step and what was measured there.
        evident: Whether measurements speak for it; otherwise it is looked at only when nothing else is left.
    """

    subtask: int
    cause: RootCause
    evident: bool


def earlier_causes(
    task: Task, subtask: int, attempt: Attempt, cause: RootCause, earlier: tuple[History, ...]
) -> list[EarlierCause]:
    """Returns the earlier steps that may be to blame for a failed attempt, the evident ones first.

    Args:
        task: The task as it was run.
        subtask: Index of the subtask that failed.
        attempt: The failed attempt.
        cause: Its cause, as far as it shows in this subtask.
        earlier: Histories of the subtasks before it; the last attempt of each is the one that stands.
    """
    found = list(_candidates(task, subtask, attempt, cause, earlier))
    return sorted(found, key=lambda candidate: not candidate.evident)


def _candidates(
    task: Task, subtask: int, attempt: Attempt, cause: RootCause, earlier: tuple[History, ...]
) -> Iterator[EarlierCause]:
    now = task.subtasks[subtask]
    before = [(h.subtask, h.iterations[-1].attempt) for h in reversed(earlier) if h.iterations]
    primitive = attempt.flow[cause.step].primitive
    takes = any(action.primitive is Primitive.GRASP for action in attempt.flow[: cause.step + 1])
    if cause.kind in _HELD and not takes:
        for index, done in before:
            found = _last(done, Primitive.GRASP, CauseKind.HELD_BADLY)
            if task.subtasks[index].target == now.target and found is not None:
                grip = found.grip or GripMeasured()
                off, force = grip.held_off_m or 0.0, grip.grip_force_n
                weak = cause.kind is CauseKind.GRIP_LOST and force is not None and force < WEAK_N
                if cause.kind is CauseKind.GRIP_LOST or off >= TAKEN_BESIDE_M:
                    # Planning knows where in the hand a thing is: beside its middle alone is no reason for no place.
                    askew = cause.kind is not CauseKind.NOWHERE or (cause.leaning_deg or 0.0) >= LEANING_DEG
                    yield EarlierCause(index, found, (off >= TAKEN_BESIDE_M and askew) or weak)
                break
    if cause.kind in _KEPT_OUT:
        places = {now.support_goal, now.support_init, now.target}
        for index, done in before:
            found = _last(done, Primitive.ARTICULATE_OPEN, CauseKind.OPENED_LITTLE)
            if task.subtasks[index].target in places and found is not None:
                reached = None if found.joint is None else found.joint.fraction_reached
                if reached is not None and reached < WIDE_ENOUGH:
                    yield EarlierCause(index, found, reached < WIDE_ENOUGH / 2 or cause.kind is CauseKind.NOWHERE)
                return
    elif cause.kind is CauseKind.JOINT_STALLED and primitive is Primitive.ARTICULATE_CLOSE:
        for index, done in before:
            found = _last(done, Primitive.UNGRASP, CauseKind.IN_THE_WAY)
            if task.subtasks[index].support_goal == now.target and found is not None:
                yield EarlierCause(index, found, False)
                return


def _last(attempt: Attempt, primitive: Primitive, kind: CauseKind) -> RootCause | None:
    step = next((s for s in range(len(attempt.flow) - 1, -1, -1) if attempt.flow[s].primitive is primitive), None)
    return None if step is None else cause_at(attempt, step, kind)
