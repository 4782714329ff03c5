"""Which contacts a motion is meant to have, as pairs of a mover and what it may touch."""

from __future__ import annotations

from collections.abc import Iterable

FINGERS = ("panda_leftfinger", "panda_rightfinger")
GRIPPER = ("panda_hand", *FINGERS)
HELD = "held object"

Allowed = frozenset[tuple[str, str]]
NOTHING: Allowed = frozenset()


def fingers_may_touch(other: str, *, hand: bool = False) -> Allowed:
    """Returns the pairs that let the fingers (and the hand's body, if asked) touch an object or one link of it.

    Args:
        other: An object id, or "id/link" for one link of it.
        hand: Whether the hand's body may touch it as well.
    """
    movers = (*FINGERS, "panda_hand") if hand else FINGERS
    return frozenset((mover, other) for mover in movers)


def held_may_touch(others: Iterable[str]) -> Allowed:
    """Returns the pairs that let the held object touch others, such as the support it is lifted from."""
    return frozenset((HELD, other) for other in others)


def is_allowed(allowed: Allowed, mover: str, owner: str, link: str) -> bool:
    """Decides whether a mover may touch an object's link: allowed by the object's id or by "id/link"."""
    return (mover, owner) in allowed or (mover, f"{owner}/{link}") in allowed
