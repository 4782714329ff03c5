"""What faults of belief do to planning, and that they leave the world alone."""

from __future__ import annotations

import numpy as np
import pytest

from executor.sim.belief import OBSTACLE, BelievedWorld, believed_scene, has_belief_fault, true_scene, weaken_grip
from executor.sim.faults import BlockedDoor, Fault, NavigationOffset, PoseError, WeakGrip, WrongScale
from tests.executor.helpers import MakeWorld, scene_at_paper_size, settle

pytestmark = pytest.mark.physics


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_a_wrong_size_keeps_the_bottom_where_it_is(make_world: MakeWorld, factor: float) -> None:
    world = make_world("kitchen_t1")
    believed = BelievedWorld(world, [WrongScale("glass_0", factor)])
    true, taken_for = world.assets["glass_0"].extent_m, believed.assets["glass_0"].extent_m
    assert taken_for == pytest.approx([factor * side for side in true])
    bottoms = [w.T_world_link("glass_0")[2, 3] - extent[2] / 2 for w, extent in ((world, true), (believed, taken_for))]
    assert bottoms[0] == pytest.approx(bottoms[1], abs=1e-6)
    held = BelievedWorld(world, [WrongScale("glass_0", factor)], frozenset({"glass_0"}))
    assert (held.T_world_link("glass_0") == world.T_world_link("glass_0")).all(), "in the hand its place is known"
    assert held.assets["glass_0"].extent_m == taken_for, "its height is not"


def test_the_oracle_has_things_of_their_believed_size_and_place(make_world: MakeWorld) -> None:
    scene = scene_at_paper_size("kitchen_t1")
    faults: tuple[Fault, ...] = (WrongScale("glass_0", 0.8), BlockedDoor("refrigerator_0", 0.6))
    true = true_scene(scene, faults)
    assert set(true.objects) - set(scene.objects) == {OBSTACLE}
    believed = believed_scene(true, faults)
    assert set(believed.objects) == set(scene.objects)
    assert believed["glass_0"].height_m == pytest.approx(0.8 * scene["glass_0"].height_m)
    assert OBSTACLE not in BelievedWorld(make_world(true), faults).assets


@pytest.mark.parametrize("fraction", [0.4, 0.6, 0.8])
def test_a_door_meets_what_blocks_it_where_the_fault_says(make_world: MakeWorld, fraction: float) -> None:
    scene = true_scene(scene_at_paper_size("kitchen_t1"), (BlockedDoor("refrigerator_0", fraction),))
    world = make_world(scene, oracle=True)

    def gap_m(opened: float) -> float:
        joint = world.assets["refrigerator_0"].joints[0]
        world.set_joint_position("refrigerator_0", joint.name, joint.position(opened))
        world.step()
        found = [c.separation_m for c in world.contacts({OBSTACLE}) if "refrigerator_0" in (c.a.owner, c.b.owner)]
        return min(found, default=1.0)

    assert gap_m(fraction - 0.05) > 0.0
    assert gap_m(fraction + 0.05) < 0.0
    assert gap_m(0.0) > 0.0


def test_a_door_without_an_upright_hinge_cannot_be_blocked() -> None:
    with pytest.raises(ValueError, match="no door with an upright hinge"):
        true_scene(scene_at_paper_size("kitchen_t1"), (BlockedDoor("table_0", 0.5),))


def test_a_weak_grip_presses_with_its_force(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    weaken_grip(world, (WeakGrip(2.0),))
    limits = [joint.force_limit for joint in world.robot.active_joints]
    assert limits[10:] == pytest.approx([2.0, 2.0]) and min(limits[:10]) > 2.0


def test_without_faults_of_belief_the_world_is_believed_as_it_is(make_world: MakeWorld) -> None:
    assert not has_belief_fault((WeakGrip(2.0), NavigationOffset(0.0, 0.1)))
    assert has_belief_fault((PoseError("glass_0", 0.0, 0.01),))
    world = make_world("kitchen_t1")
    settle(world, 0.1)
    believed = BelievedWorld(world, ())
    assert np.allclose(believed.T_world_link("glass_0"), world.T_world_link("glass_0"))
    assert believed.time_s == world.time_s
