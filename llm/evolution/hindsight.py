"""Whether the cause of a failure lies in an earlier subtask, which was reached at the time.

An item that was taken beside its middle slips when it is carried; a door that was opened by a little lets no hand
in; an item that stands too near to the front keeps a door from closing. What was measured at the time says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from llm.evolution.cause import CauseKind, RootCause, cause_at
from llm.evolution.corrections.edits import last_up_to
from oag import Attempt, History, Primitive, SimpleTask, Task
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
    takes = any(action.primitive is Primitive.GRASP for action in attempt.flow[: cause.step + 1])

    def latest(
        fits: Callable[[SimpleTask], bool], primitive: Primitive, kind: CauseKind
    ) -> tuple[int, RootCause] | None:
        """Returns the last step of a primitive in the latest earlier subtask that has one and fits."""
        for history in reversed(earlier):
            if history.iterations and fits(task.subtasks[history.subtask]):
                done = history.iterations[-1].attempt
                step = last_up_to(done.flow, len(done.flow) - 1, primitive)
                if step is not None:
                    return history.subtask, cause_at(done, step, kind)
        return None

    if cause.kind in _HELD and not takes:
        taken = latest(lambda task: task.target == now.target, Primitive.GRASP, CauseKind.HELD_BADLY)
        if taken is not None:
            grip = taken[1].grip or GripMeasured()
            off, force = grip.held_off_m or 0.0, grip.grip_force_n
            weak = cause.kind is CauseKind.GRIP_LOST and force is not None and force < WEAK_N
            if cause.kind is CauseKind.GRIP_LOST or off >= TAKEN_BESIDE_M:
                # Planning knows where in the hand a thing is: beside its middle alone is no reason for no place.
                askew = cause.kind is not CauseKind.NOWHERE or (cause.leaning_deg or 0.0) >= LEANING_DEG
                yield EarlierCause(*taken, (off >= TAKEN_BESIDE_M and askew) or weak)
    if cause.kind in _KEPT_OUT:
        places = {now.support_goal, now.support_init, now.target}
        opened = latest(lambda task: task.target in places, Primitive.ARTICULATE_OPEN, CauseKind.OPENED_LITTLE)
        if opened is not None and opened[1].joint is not None:
            reached = opened[1].joint.fraction_reached
            if reached < WIDE_ENOUGH:
                yield EarlierCause(*opened, reached < WIDE_ENOUGH / 2 or cause.kind is CauseKind.NOWHERE)
    elif cause.kind is CauseKind.JOINT_STALLED and attempt.flow[cause.step].primitive is Primitive.ARTICULATE_CLOSE:
        left = latest(lambda task: task.support_goal == now.target, Primitive.UNGRASP, CauseKind.IN_THE_WAY)
        if left is not None:
            yield EarlierCause(*left, False)
