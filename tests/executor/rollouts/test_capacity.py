"""Sizes alone refuse only what fits in no way, and say how large thing and room are."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bddl
from executor.assets.model import Region, Rim
from executor.planning.placements import GAPS_M, MOST_FALL_M, release_gaps_m
from executor.rollouts.capacity import no_room
from oag import SimpleTask
from oag.model.robots import LIFTED, PAPER_ROBOT
from oag.model.symbols import GRIPPER

LENGTH = st.floats(0.02, 0.6)
SIZE = st.tuples(LENGTH, LENGTH, LENGTH)
INSIDE = bddl.Atom("inside", ("thing_0", "place_0"))
PUT = SimpleTask("put", "Put it.", "thing_0", None, "place_0", bddl.Atom("inside", ("thing_0", GRIPPER)), INSIDE, ())


def room(size: tuple[float, float, float], *, upward: bool, name: str = "room") -> Region:
    half = (size[0] / 2, size[1] / 2, size[2] / 2)
    return Region(name, "interior", "body", (0.0, 0.0, 0.0), half, (0.0, 0.0, 1.0) if upward else (-1.0, 0.0, 0.0))


def world(item: tuple[float, float, float], region: Region, rim: Rim | None = None, up: float = 1.0) -> Any:
    pose = np.diag([1.0, 1.0, up, 1.0])
    solid = SimpleNamespace(kind="box", collides=True)
    thing = SimpleNamespace(extent_m=item, links=[SimpleNamespace(shapes=[solid])])
    assets = {"thing_0": thing, "place_0": SimpleNamespace(regions=[region], rim=rim)}
    return SimpleNamespace(assets=assets, T_world_link=lambda _: pose, dynamic_ids=("thing_0", "place_0"))


@given(item=SIZE, size=SIZE)
def test_what_stands_in_a_compartment_in_some_turn_is_not_refused(
    item: tuple[float, float, float], size: tuple[float, float, float]
) -> None:
    x, y, z = item
    turned = ((x, y), (y, x))
    fits = z <= size[2] and any(a <= size[0] and b <= size[1] for a, b in turned)
    refused = no_room(world(item, room(size, upward=False)), PUT)
    assert not (fits and refused)
    if z > size[2] or min(x, y) > min(size[:2]):
        assert refused is not None and "too large" in refused.message


@given(item=SIZE, size=SIZE)
def test_what_comes_in_from_above_in_any_way_up_is_not_refused(
    item: tuple[float, float, float], size: tuple[float, float, float]
) -> None:
    fits = any(a <= size[0] and b <= size[1] for a, b, _ in itertools.permutations(item))
    lies = world(item, room(size, upward=True), up=0.0)
    assert not (fits and no_room(lies, PUT))
    stands = world(item, room(size, upward=True))
    assert not (fits and item[2] / 2 <= size[2] and no_room(stands, PUT))


@pytest.mark.parametrize(
    ("width_m", "height_m", "up", "stands_out"),
    [(0.14, 0.19, 1.0, True), (0.07, 0.19, 1.0, False), (0.07, 0.095, 1.0, False), (0.14, 0.19, 0.0, False)],
    ids=["on the rim", "between the walls", "low", "lying"],
)
def test_what_keeps_its_middle_above_a_bowls_rim_as_upright_as_it_has_to_be_is_refused(
    width_m: float, height_m: float, up: float, stands_out: bool
) -> None:
    bowl = Rim((0.0, 0.0, 0.025), 0.08, 0.004, 0.6, 0.06, 16)
    found = no_room(world((width_m, width_m, height_m), room((0.13, 0.13, 0.05), upward=True), bowl, up), PUT)
    assert (found is not None) is stands_out
    assert found is None or ("stands out" in found.message and "95 mm" in found.message and "50 mm" in found.message)


def test_a_bottle_is_too_wide_for_a_mug_and_a_die_is_not() -> None:
    mug = Rim((0.0, 0.0, 0.05), 0.033, 0.004, 0.0, 0.08, 12)
    hollow = room((0.05, 0.05, 0.08), upward=True, name="hollow")
    assert no_room(world((0.065, 0.065, 0.22), hollow, mug), PUT)
    assert no_room(world((0.025, 0.025, 0.025), hollow, mug), PUT) is None


@pytest.mark.parametrize(("robot", "wide_m"), [(LIFTED, 0.2), (PAPER_ROBOT, 0.12)])
def test_into_what_the_open_hand_does_not_fit_things_fall_from_above_its_rim(robot: Any, wide_m: float) -> None:
    die = SimpleNamespace(extent_m=(0.025, 0.025, 0.025))
    mug, bowl = (room((width_m, width_m, 0.08), upward=True, name="hollow") for width_m in (0.05, wide_m))
    *usual, over_m = release_gaps_m(robot.hand, die, mug)  # type: ignore[arg-type]
    assert tuple(usual) == GAPS_M and 0.08 - 0.025 / 2 < over_m <= MOST_FALL_M
    assert release_gaps_m(robot.hand, die, bowl) == GAPS_M  # type: ignore[arg-type]
