"""What a flow holds in store: the actions that come after the running one."""

from __future__ import annotations

from executor.motion.planning.moves import MOVES
from executor.session.session import Session
from oag import Action, Primitive

Step = tuple[int, Action]
"""An action and its index in the flow."""


def next_of(session: Session, *primitives: Primitive) -> Step | None:
    """Returns the next action of one of some kinds with its step index, the running step included, or None."""
    for index in range(session.step, len(session.flow)):
        if session.flow[index].primitive in primitives:
            return index, session.flow[index]
    return None


def moves_after(session: Session, primitive: Primitive) -> list[Step]:
    """Returns the unbroken run of parameterised moves after the next action of a kind, with step indices."""
    found = next_of(session, primitive)
    moves: list[Step] = []
    if found is not None:
        for index in range(found[0] + 1, len(session.flow)):
            if session.flow[index].primitive not in MOVES:
                break
            moves.append((index, session.flow[index]))
    return moves


def moves_before(session: Session, primitive: Primitive) -> list[Step]:
    """Returns the parameterised moves between the running step and the next action of a kind, with step indices."""
    moves: list[Step] = []
    for index in range(session.step + 1, len(session.flow)):
        if session.flow[index].primitive is primitive:
            return moves
        if session.flow[index].primitive in MOVES:
            moves.append((index, session.flow[index]))
    return []


def planned_moves(moves: list[Step]) -> list[Step]:
    """Returns the moves that planning ahead counts: all but the corrections.

    Straight sideways or forward moves of the hand between two LIFT_EEF_DOWN are corrections of the place, made over
    it. Counted in, they would be planned away: the base would stand elsewhere, and the thing end where it did before.
    """
    lowered = [place for place, (_, action) in enumerate(moves) if action.primitive is Primitive.LIFT_EEF_DOWN]
    if not lowered:
        return moves
    return [
        step
        for place, step in enumerate(moves)
        if not (lowered[0] < place < lowered[-1] and step[1].primitive in _CORRECTING and _is_number(step[1]))
    ]


_CORRECTING = (
    Primitive.MOVE_EEF_FORWARD,
    Primitive.MOVE_EEF_BACKWARD,
    Primitive.MOVE_EEF_LEFT,
    Primitive.MOVE_EEF_RIGHT,
)


def _is_number(action: Action) -> bool:
    return isinstance(action.parameter, int | float)


def keep_numbers(session: Session, steps: list[Step], filled: tuple[Action, ...]) -> None:
    """Stores the numbers that planning ahead has chosen, for the primitives that will run them."""
    for (index, _), action in zip(steps, filled, strict=True):
        if isinstance(action.parameter, float | int):
            session.filled[index] = float(action.parameter)
