"""A release closes no circle: every tower has the facts of a chain that is asked for, however few are listed."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from oag.model.symbols import Fact
from oag.primitives import cargo
from oag.primitives.cargo import Carriage, carriage_of, towers

ITEMS = ("bowl_0", "cup_0", "pan_0", "plate_0", "tray_0")
FACTS: tuple[Fact, ...] = tuple((relation, *pair) for relation in cargo.RESTING for pair in permutations(ITEMS, 2))


def every_tower(carriage: Carriage, above: str, below: str) -> Iterator[tuple[Fact, ...]]:
    """List the chains by which one thing would be on or in another, through any order of the things between."""
    others = [name for name in ITEMS if name not in (above, below)]
    for count in range(len(others) + 1):
        for between in permutations(others, count):
            names = (above, *between, below)
            for relation in cargo.RESTING:
                relations = (relation, *["ontop"] * count)
                chain = tuple((r, names[i], names[i + 1]) for i, r in enumerate(relations))
                if all(fact[::2] in carriage.places_of(fact[1]) for fact in chain):
                    yield chain


@given(st.sets(st.sampled_from(FACTS), max_size=25), st.integers(1, 12))
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_tower_escapes_the_limit(monkeypatch: pytest.MonkeyPatch, excluded: set[Fact], limit: int) -> None:
    carriage = carriage_of(ITEMS, ITEMS, dict.fromkeys(excluded, False), ())
    all_towers = set(every_tower(carriage, "tray_0", "bowl_0"))
    assert set(towers(carriage, "tray_0", "bowl_0")) == all_towers
    with monkeypatch.context() as patch:
        patch.setattr(cargo, "_MOST_TOWERS", limit)
        listed = [set(chain) for chain in towers(carriage, "tray_0", "bowl_0")]
    assert all(any(chain <= set(tower) for chain in listed) for tower in all_towers)
    assert len(listed) <= 2 * len(ITEMS) * (limit + len(ITEMS))
