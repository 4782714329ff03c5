"""Intents that arrange given things: swap, nest, stack and unstack them, or bring them near the robot's start."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from llm.offline.grounding import Grounding
from llm.offline.intents import Intent, IntentKind, Refusal, Support, Surroundings, enumeration
from llm.offline.viewpoint import start_gap_m


def swapped(ids: Sequence[str], around: Surroundings) -> tuple[Intent, ...]:
    """Return the intents that put each of two things where the other is."""
    if len(ids) != 2:
        raise Refusal("several-objects", f"two things can be swapped, and it names {enumeration(ids)}")
    objects = around.scene.objects
    first, second = (next((s for s in around.supports(key) if s.object_id in objects), None) for key in ids)
    if first is None or second is None:
        lost = ids[0] if first is None else ids[1]
        raise Refusal("unknown-place", f"the scene does not state what {lost} stands on")
    if first == second:
        problem = f"{enumeration(ids)} are both {first}; a plan can tell places apart, but no spots of one place"
        raise Refusal("unsupported-relation", problem)
    return (
        Intent(IntentKind.PLACE, ids[0], second.relation, second.object_id),
        Intent(IntentKind.PLACE, ids[1], first.relation, first.object_id),
    )


def nested(ids: Sequence[str], around: Surroundings) -> tuple[Intent, ...]:
    """Return the intents that put things into each other, the largest one outside."""
    if len(ids) < 2:
        raise Refusal("several-objects", f"at least two things go into each other, and it names {enumeration(ids)}")
    ordered = by_footprint(ids, around)
    return tuple(Intent(IntentKind.PLACE, inner, "inside", outer) for outer, inner in pairwise(ordered))


def by_footprint(ids: Sequence[str], around: Surroundings) -> list[str]:
    """Return things by the area that they stand on, the largest first."""
    return sorted(ids, key=lambda key: -math.prod(around.scene.objects[key].extent_m[:2]))


def stacked(ids: Sequence[str], around: Surroundings, lowest: Intent | None = None) -> tuple[Intent, ...]:
    """Return the intents that put things onto each other, the largest one lowest, where `lowest` says."""
    if lowest is None and len(ids) < 2:
        raise Refusal("missing-place", f"it does not say what to stack {enumeration(ids)} on")
    pile = (Intent(IntentKind.PLACE, upper, "ontop", lower) for lower, upper in pairwise(by_footprint(ids, around)))
    return (*(() if lowest is None else (lowest,)), *pile)


def unstacked(ids: Sequence[str], around: Surroundings) -> tuple[Intent, ...]:
    """Return the intents that put things that stand on others next to the lowest of these, the topmost first."""
    fixtures = {key for key, thing in around.scene.objects.items() if thing.role == "A"}
    found: list[tuple[int, Intent]] = []
    for key in ids:
        chain = around.chain(key)
        base = next((step for step in chain if step.object_id in fixtures), None)
        if base is not None and base != chain[0]:
            found.append((len(chain), Intent(IntentKind.PLACE, key, base.relation, base.object_id)))
    if not found:
        raise Refusal("already-so", "nothing of it stands on another thing; there is nothing to do")
    return tuple(intent for _, intent in sorted(found, key=lambda entry: -entry[0]))


def brought(ids: Sequence[str], grounding: Grounding) -> tuple[tuple[Intent, ...], str]:
    """Return the intents that put things onto what is nearest to the robot's start, since nothing can be handed.

    The one thing that stands there already is picked up, and held.
    """
    around, names = grounding.around, grounding.names
    grounds = [category for category, entry in names.entries.items() if entry is not None and entry.ground]
    tops = [
        key
        for key, thing in around.scene.objects.items()
        if thing.role == "A" and around.affordances[key].surface and thing.category not in grounds
    ]
    if not tops:
        raise Refusal("missing-place", "nothing can be handed over, and no surface is near the robot's start")
    nearest = min(tops, key=lambda key: start_gap_m(key, around.scene))
    there = f"{nearest}, the nearest surface to the robot's start"
    if all(Support("ontop", nearest) in around.supports(key) for key in ids):
        if len(ids) == 1:
            return (Intent(IntentKind.PICK, ids[0]),), f"{ids[0]} stands already on {there}; it is picked up and held"
        raise Refusal("already-so", f"nothing can be handed over, and {enumeration(ids)} stand already on {there}")
    intents = tuple(Intent(IntentKind.PLACE, key, "ontop", nearest) for key in ids)
    return intents, f"nothing can be handed over; it is brought to {there}"
