"""Buttons and knobs in the physics: latches, springs, and what the detectors read of them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from bddl import Atom
from executor.assets.families import controls
from executor.planning.openings import open_joints
from executor.sim.detectors import read
from executor.sim.world import World
from tests.executor.appliances import appliance

pytestmark = pytest.mark.physics
BUTTON, KNOB = "button_slide", "knob_hinge"


@pytest.fixture
def microwave() -> Iterator[World]:
    with World(appliance("microwave", "button", 0)) as world:
        yield world


@pytest.fixture
def oven() -> Iterator[World]:
    with World(appliance("oven", "knob", 0)) as world:
        yield world


def is_on(world: World, name: str) -> bool | None:
    return read(Atom("toggled_on", (name,)), world).value


def push(world: World, name: str, joint: str, force: float, duration_s: float = 0.5) -> float:
    """Push a joint with a constant force [N] or torque [Nm], then let go; return the farthest position."""
    (articulation,) = (each for each in world.sapien_scene.get_all_articulations() if each.name == name)
    names = [each.name for each in articulation.active_joints]
    farthest = 0.0
    for applied in (force, 0.0):
        articulation.set_qf([applied if each == joint else 0.0 for each in names])
        for _ in range(round(duration_s / world.timestep_s)):
            world.step()
            farthest = max(farthest, world.joint_position(name, joint))
    return farthest


def test_a_button_that_is_half_pressed_comes_back_and_switches_nothing(microwave: World) -> None:
    half_n = 0.75 * controls.BUTTON_CLICK_M * controls.BUTTON_SPRING_N_M
    farthest_m = push(microwave, "microwave_0", BUTTON, half_n)
    assert controls.BUTTON_ON_M < farthest_m < controls.BUTTON_CLICK_M
    assert microwave.joint_position("microwave_0", BUTTON) == pytest.approx(0.0, abs=1e-4)
    assert is_on(microwave, "microwave_0") is False


def test_a_button_that_is_pressed_through_stays_in_and_the_next_press_lets_it_out(microwave: World) -> None:
    for wanted in (True, False, True):
        push(microwave, "microwave_0", BUTTON, 8.0)
        assert is_on(microwave, "microwave_0") is wanted
        rest_m = controls.BUTTON_SET_M if wanted else 0.0
        assert microwave.joint_position("microwave_0", BUTTON) == pytest.approx(rest_m, abs=1e-4)


def test_a_button_that_is_held_in_changes_once(microwave: World) -> None:
    push(microwave, "microwave_0", BUTTON, 8.0, duration_s=3.0)
    assert is_on(microwave, "microwave_0") is True


def test_the_latch_is_part_of_a_packed_state(microwave: World) -> None:
    push(microwave, "microwave_0", BUTTON, 8.0)
    with World(microwave.scene) as other:
        other.unpack(microwave.pack())
        push(other, "microwave_0", BUTTON, 0.0)
        assert is_on(other, "microwave_0") is True
        push(other, "microwave_0", BUTTON, 8.0)
        assert is_on(other, "microwave_0") is False


@pytest.mark.parametrize(("held_m", "lets_out"), [(0.0095, False), (0.0085, True)])
def test_a_press_goes_on_where_a_state_was_packed(microwave: World, held_m: float, lets_out: bool) -> None:
    push(microwave, "microwave_0", BUTTON, 8.0)
    microwave.set_joint_position("microwave_0", BUTTON, held_m)
    microwave.unpack(microwave.pack())
    push(microwave, "microwave_0", BUTTON, 8.0)
    assert is_on(microwave, "microwave_0") is not lets_out


def test_a_button_that_is_latched_is_no_open_door(microwave: World) -> None:
    push(microwave, "microwave_0", BUTTON, 8.0)
    assert read(Atom("open", ("microwave_0",)), microwave).value is False
    assert open_joints(microwave, "microwave_0") == ()


@pytest.mark.parametrize(("share", "expected"), [(0.0, False), (0.48, False), (0.52, True), (1.0, True)])
def test_a_knob_counts_from_half_of_its_range_on_and_stays_where_it_is(
    oven: World, share: float, expected: bool
) -> None:
    oven.set_joint_position("oven_0", KNOB, share * controls.KNOB_RANGE_RAD)
    for _ in range(100):
        oven.step()
    reading = read(Atom("toggled_on", ("oven_0",)), oven)
    assert reading.value is expected
    assert reading.measurements.control == KNOB
    assert reading.measurements.turned_deg == pytest.approx(60.0 * share, abs=0.1)


def test_a_knob_gives_way_to_more_than_its_friction_alone(oven: World) -> None:
    assert push(oven, "oven_0", KNOB, 0.8 * controls.KNOB_FRICTION_NM) < 0.01
    assert push(oven, "oven_0", KNOB, 2.0 * controls.KNOB_FRICTION_NM) > controls.KNOB_ON * controls.KNOB_RANGE_RAD
    assert is_on(oven, "oven_0") is True


def test_what_has_neither_is_off_and_what_starts_switched_on_is_on(oven: World) -> None:
    with World(appliance("lamp", "button", 0, switched="on")) as world:
        for _ in range(50):
            world.step()
        assert is_on(world, "lamp_0") is True
        assert is_on(world, "table_0") is False
        has = {name: read(Atom(f"has_{name}", ("lamp_0",)), world).value for name in ("button", "knob")}
        assert has == {"button": True, "knob": False}
    assert read(Atom("has_knob", ("oven_0",)), oven).value is True
