"""The primitives with their functions, and the parameterised moves: straight hand motions, base slides and turns.

The 21 have theirs here, and so have the domains of appliances and of fallen things. One of another domain gets its
function by `add_skill`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from bddl.errors import Scene2DemoError
from executor.planning.planner import EEF_DIRECTIONS, MOVES, TURN_SIGNS, move_path
from executor.records import Failure, FailureKind
from executor.skills.articulate import articulate
from executor.skills.grasp import approach, converge, grasp, ungrasp
from executor.skills.navigate import navigate_to_target, retreat
from executor.skills.navigate_to_support import navigate_to_support
from executor.skills.push import push, pushes
from executor.skills.session import Session, StepResult
from executor.skills.switch import press, turn
from executor.skills.upright import ROW as SET_UPRIGHT
from executor.skills.upright import set_upright
from executor.system.effort import SearchExhausted
from oag import Action, Primitive, Task
from oag.measurements import MoveMeasured, OutOfReach, UnmeantContact, Unplanned, first_of
from oag.model.domain import own_of

EEF_SPEED = 0.6  # Of the limits: these moves end at things.
BASE_SPEED = 0.7  # And so do the base's.
REACH_STEP_M = 0.005


def move(session: Session, action: Action) -> StepResult:
    """Move by the action's number, or by the planned one, and stop at unintended contact; push what is to be pushed."""
    if action.primitive is Primitive.MOVE_EEF_FORWARD and pushes(session.subtask):
        return push(session, action)
    planned = session.plan.numbers.get(session.step)
    amount = action.parameter if action.parameter is not None else planned
    if not isinstance(amount, float | int):
        return session.done(action, failure=_missing_amount(session, action.primitive))
    filled = replace(action, parameter=float(amount))
    session.sync_planner()
    path = move_path(session.planner, session.q, action.primitive, float(amount))
    if path.path is None:
        reach_m = _reach_m(session, action.primitive, float(amount))
        short_m = float(amount) - reach_m
        message = f"the arm reaches {reach_m:.2f} m of {amount:g} m along {action.primitive.name}"
        short = OutOfReach(round(short_m, 4), round(reach_m, 4), float(amount), path.at_limit)
        return session.done(filled, short, failure=Failure(FailureKind.UNREACHABLE, message, (short,)))
    before = session.planner.kinematics.forward(session.control.q)
    allowed = session.hand.lifted_from
    if session.hand.gripped is not None:
        # A hand that still holds a handle moves the door, or presses on it: that contact is what it is for.
        allowed = allowed | session.hand.released
    speed = EEF_SPEED if action.primitive in EEF_DIRECTIONS else BASE_SPEED
    failure = session.control.follow(path.path, speed=speed, monitor=session.monitor(allowed))
    after = session.planner.kinematics.forward(session.control.q)
    turned = action.primitive in TURN_SIGNS
    moved = MoveMeasured(
        asked_m=None if turned else float(amount),
        asked_deg=float(amount) if turned else None,
        eef_moved_m=round(float(np.linalg.norm(after[:3, 3] - before[:3, 3])), 4),
    )
    if failure is not None and _set_down(session, action, failure):
        return session.done(filled, replace(moved, set_down=True), *failure.measurements)
    return session.done(filled, moved, failure=failure)


def _missing_amount(session: Session, primitive: Primitive) -> Failure:
    """Return why a move has no number: no place was found, or no primitive plans ahead for it."""
    unplaced = session.plan.unplaced
    if unplaced is not None:
        return replace(unplaced, message=f"{primitive.name} has no number: {unplaced.message}")
    message = f"{primitive.name} has no number, and nothing was planned ahead for it"
    return Failure(FailureKind.PRECONDITION, message)


def _reach_m(session: Session, primitive: Primitive, amount_m: float) -> float:
    """Return how far along a straight line the arm reaches, to within `REACH_STEP_M`.

    The residual of the line's solver is no such distance: its waypoints beyond reach end anywhere.
    """
    reached, beyond = 0.0, amount_m
    while beyond - reached > REACH_STEP_M:
        half = (reached + beyond) / 2
        if move_path(session.planner, session.q, primitive, half).path is None:
            beyond = half
        else:
            reached = half
    return reached


def _set_down(session: Session, action: Action, failure: Failure) -> bool:
    """Return whether a motion ended because the held item came to rest on its support: the purpose of lowering."""
    met = first_of(failure.measurements, UnmeantContact)
    return (
        action.primitive is Primitive.LIFT_EEF_DOWN
        and failure.kind is FailureKind.COLLISION
        and met is not None
        and met.mover == session.hand.held
        and met.other == session.subtask.support_goal
    )


MOST_EFFORT_S = 12.0
"""How much planning one primitive may take (`Effort`) [s]; what takes more is neither possible nor impossible."""


def bounded(runner: Runner, session: Session, action: Action) -> StepResult:
    """Run a primitive; a search that has taken `MOST_EFFORT_S` ends it with what stood in the way most often."""
    try:
        with session.planner.effort.limited(MOST_EFFORT_S):
            return runner(session, action)
    except SearchExhausted as exhausted:
        subtask, met = session.subtask, exhausted.met
        often = f"; most often {next(iter(met))} meet" if met else ""
        message = (
            f"no answer in the time for {action.primitive.name}: none among {exhausted.looked_at} configurations{often}"
        )
        found = Unplanned(
            target=subtask.target, support=subtask.support_goal, looked_at=exhausted.looked_at, in_the_way=met or None
        )
        return session.done(action, failure=Failure(FailureKind.NO_ANSWER, message, (found,)))


Runner = Callable[[Session, Action], StepResult]

LIBRARY: Mapping[Primitive, Runner] = MappingProxyType(
    {
        Primitive.APPROACH: approach,
        Primitive.CONVERGE: converge,
        Primitive.GRASP: grasp,
        Primitive.ARTICULATE_OPEN: articulate,
        Primitive.ARTICULATE_CLOSE: articulate,
        Primitive.UNGRASP: ungrasp,
        Primitive.RETREAT: retreat,
        Primitive.NAVIGATE_TO_TARGET: navigate_to_target,
        Primitive.NAVIGATE_TO_SUPPORT: navigate_to_support,
        **{primitive: move for primitive in MOVES},
    }
)
"""Each of the 21 primitives with the function that runs it."""

_ADDED: dict[str, Runner] = {
    "PRESS_ON": press,
    "PRESS_OFF": press,
    "TURN_ON": turn,
    "TURN_OFF": turn,
    SET_UPRIGHT: set_upright,
}
"""Those of the domains of appliances and of fallen things, and what `add_skill` adds."""


class MissingSkill(Scene2DemoError, ValueError):
    """The robot has no skill for a primitive of an own domain."""


def add_skill(name: str, runner: Runner, *, replace: bool = False) -> None:
    """Let the robot execute the primitive of an own domain that has a name, in this process.

    Args:
        name: Of its row, such as `PUSH`.
        runner: Takes the session and the action. It moves the robot through `session.control`, and returns
            `session.done(action, ...)`, with a `Failure` where it ended early.
        replace: Take it in place of the skill that was added before, as a notebook does whose cell runs again.

    Raises:
        TypeError: The name is no text, or the runner no function.
        ValueError: The name is empty, one of the 21, or has another skill already.
    """
    given: tuple[object, object] = name, runner  # As untyped programs and notebooks hand them over.
    if not isinstance(given[0], str) or not callable(given[1]):
        raise TypeError(f"expected the name of a row and a function, got {name!r} and {runner!r}")
    if not name.strip():
        raise ValueError("the name is empty, expected that of a row, such as PUSH")
    if name in Primitive.__members__:
        raise ValueError(f"{name} is one of the 21 primitives; choose another name for the row")
    if not replace and _ADDED.get(name, runner) != runner:
        raise ValueError(f"{name} has a skill already; choose another name for the row, or give replace=True")
    _ADDED[name] = runner


def skill_of(primitive: Primitive) -> Runner:
    """Return the function that runs a primitive.

    Raises:
        MissingSkill: It is one of an own domain, and none was added for it.
    """
    own = own_of(primitive)
    runner = LIBRARY[primitive] if own is None else _ADDED.get(own.row.name)
    if runner is None:
        hint = "executor.add_skill gives it one"
        raise MissingSkill(f"the robot has no skill for {primitive.name.split()[0]}; {hint}")
    return runner


def require_skills(task: Task) -> None:
    """Check that the robot has a skill for each primitive of a task; raises MissingSkill."""
    for subtask in task.subtasks:
        for action in subtask.flow or ():
            skill_of(action.primitive)
