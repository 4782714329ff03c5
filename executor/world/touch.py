"""Bodies of a physics scene, and what touches what, read from the engine's contacts in a fixed order."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

GROUND = "ground"
ROBOT = "robot"


@dataclass(frozen=True, slots=True, order=True)
class BodyRef:
    """One rigid body.

    Attributes:
        owner: "robot", "ground" or an object's id.
        link: Link name; the asset's root link for a single body, "ground" for the ground.
    """

    owner: str
    link: str


@dataclass(frozen=True, slots=True)
class Contact:
    """Two bodies that touch or nearly do.

    Attributes:
        a, b: The bodies; the robot's comes first, then by name.
        separation_m: Smallest distance over the contact points; negative where they overlap.
        impulse_ns: Sum of the points' impulse norms over the last step, in newton seconds.
    """

    a: BodyRef
    b: BodyRef
    separation_m: float
    impulse_ns: float


def pairs_nearer(
    engine_contacts: Any, owner_of: Mapping[Any, BodyRef], owners: Container[str], within_m: float
) -> Iterator[tuple[BodyRef, BodyRef, float]]:
    """Yields pairs of bodies that are nearer than a distance, with the gap between them, in the engine's order.

    Args:
        engine_contacts: What the engine's `get_contacts` returns.
        owner_of: The engine's bodies -> what they are.
        owners: Only pairs of which one body's owner is in it.
        within_m: The distance.
    """
    for contact in engine_contacts:
        first, second = contact.bodies
        a, b = owner_of[first], owner_of[second]
        if a.owner in owners or b.owner in owners:
            gap_m = min((point.separation for point in contact.points), default=math.inf)
            if gap_m < within_m:
                yield (a, b, gap_m) if _comes_first(a, b) else (b, a, gap_m)


def contacts_of(
    engine_contacts: Any, owner_of: Mapping[Any, BodyRef], owners: Container[str] | None
) -> tuple[Contact, ...]:
    """Returns the pairs of bodies that have contact points, one contact a pair, sorted.

    Args:
        engine_contacts, owner_of: As for `pairs_nearer`.
        owners: When given, only pairs of which one body's owner is in it.
    """
    found: dict[tuple[int, int], tuple[BodyRef, BodyRef, float, float]] = {}
    for contact in engine_contacts:
        first, second = contact.bodies
        a, b = owner_of[first], owner_of[second]
        if owners is not None and a.owner not in owners and b.owner not in owners:
            continue
        points = contact.points
        if not points:
            continue
        # Identities hash faster than names, and this runs thousands of times a second.
        key = (id(a), id(b)) if id(a) < id(b) else (id(b), id(a))
        _, _, separation, impulse = found.get(key, (a, b, math.inf, 0.0))
        for point in points:
            separation = min(separation, point.separation)
            x, y, z = point.impulse.tolist()
            impulse += math.sqrt(x * x + y * y + z * z)
        found[key] = (a, b, separation, impulse)
    ordered = ((a, b, s, i) if _comes_first(a, b) else (b, a, s, i) for a, b, s, i in found.values())
    return tuple(Contact(*fields) for fields in sorted(ordered))


def _comes_first(a: BodyRef, b: BodyRef) -> bool:
    return (a.owner != ROBOT, a) <= (b.owner != ROBOT, b)
