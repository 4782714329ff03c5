"""In which order the ways of opening and closing are tried, over all handles that will do."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from executor.assets.model import Handle
from executor.geometry import Array
from executor.motion.articulation.purpose import Serves
from executor.motion.articulation.stances import (
    edge_stances,
    push_stances,
    rigid_stances,
    tracked_stances,
)
from executor.motion.articulation.work import Swing, Work, possible_fractions
from executor.motion.planning.planner import Planner
from executor.motion.stances.stance import Stance
from executor.world.world import World
from oag import Action, Primitive

Way = Callable[..., Iterator[Stance[Swing]]]

OPENING: tuple[tuple[Way, bool], ...] = (
    (rigid_stances, False),
    (tracked_stances, False),
    (rigid_stances, True),
    (tracked_stances, True),
    (push_stances, False),
    (push_stances, True),
)
"""Each way with whether it may do less than was asked; what is missing is left to another stage."""

CLOSING: tuple[tuple[Way, bool], ...] = (
    (rigid_stances, False),
    (tracked_stances, False),
    (push_stances, False),
    (edge_stances, False),
    (rigid_stances, True),
    (tracked_stances, True),
    (push_stances, True),
    (edge_stances, True),
)
GOING_ON: tuple[tuple[Way, bool], ...] = (
    (push_stances, False),
    (rigid_stances, False),
    (tracked_stances, False),
    (push_stances, True),
)
"""For a joint that an earlier stage has brought part of the way."""


def articulation_stances(
    planner: Planner,
    world: World,
    object_id: str,
    handles: tuple[Handle, ...],
    action: Action,
    here: Array,
    *,
    going_on: bool = False,
    serves: Serves = lambda _: True,
) -> Iterator[Iterator[Stance[Swing]]]:
    """Yields, for one way of moving a joint after the other, the stances from which it can be done.

    Args:
        planner: Synchronised with the world.
        world: Where things are.
        object_id: The articulated object.
        handles: Those that will do, the preferred one first.
        action: ARTICULATE_OPEN or ARTICULATE_CLOSE, filled or not.
        here: (3,) where the base stands.
        going_on: Whether an earlier stage has brought the joint part of the way.
        serves: Whether a handle is one that later subtasks can do with; asked only where there are several. Others
            are tried last.
    """
    first = OPENING if action.primitive is Primitive.ARTICULATE_OPEN else CLOSING
    for useful in (True, False):
        for way, partial in GOING_ON if going_on else first:
            for handle in handles:
                if (len(handles) == 1 or serves(handle)) is not useful:
                    continue
                work = Work(planner, world, object_id, handle, action)
                if not partial or _has_a_rest(work):
                    yield way(work, here, partial=partial)


def _has_a_rest(work: Work) -> bool:
    """Decides whether doing less is of use: later stages can do the rest, or the flow leaves open how much it is."""
    wanted = work.action.parameter is None or bool(possible_fractions(work, partial=False))
    return wanted and bool(work.smaller)
