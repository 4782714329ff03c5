"""The library under physics: things settle where they stand, joints move by force to their limits, nothing overlaps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

sapien = pytest.importorskip("sapien")

from bddl import Atom  # noqa: E402
from executor.assets.build import BuiltAsset, build_asset  # noqa: E402
from executor.assets.library import LIBRARY, asset_for, kind, sample  # noqa: E402
from executor.assets.model import Asset, Link, Region, Shape  # noqa: E402
from executor.assets.resistance import lever_of, with_resistance  # noqa: E402
from executor.sim.detectors import read  # noqa: E402
from executor.sim.engine import TIMESTEP_S  # noqa: E402
from oag import Kind, RobotPose, Scene  # noqa: E402
from tests.executor.assets.sweep import Sweep  # noqa: E402
from tests.executor.helpers import MakeWorld, at, settle  # noqa: E402

pytestmark = pytest.mark.physics
SEEDS = range(5)
ARTICULATED = sorted(model for model in LIBRARY if kind(LIBRARY[model]) is Kind.ARTICULATED)
ITEMS = sorted(model for model in LIBRARY if kind(LIBRARY[model]) is Kind.ITEM)
SPACING_M = 3.0
SETTLED_M = 0.001
DEEPEST_M = -1e-4
MASS_KG = {"die": (0.02, 0.3), "teddy_bear": (0.02, 0.3), "bottle": (0.2, 0.9), "plate": (0.15, 0.8), "mug": (0.1, 0.5)}


@pytest.fixture
def scene() -> Iterator[object]:
    """Return an empty physics scene with a floor."""
    sapien.physx.set_scene_config(bounce_threshold=2.0)
    sapien.physx.set_body_config(solver_position_iterations=15, solver_velocity_iterations=1)
    made = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    made.set_timestep(TIMESTEP_S)
    made.add_ground(0.0, render=False)
    yield made
    del made


def _placed(scene: object, asset: Asset, place: int) -> BuiltAsset:
    T = at(SPACING_M * (place % 8), SPACING_M * (place // 8), asset.extent_m[2] / 2)
    return build_asset(scene, f"asset_{place}", asset, T, visual=False)


def test_items_settle_on_the_floor_without_moving(scene: object) -> None:
    built = []
    for place, (model, seed) in enumerate((m, s) for m in ITEMS for s in SEEDS):
        built.append((model, seed, _placed(scene, asset_for(sample(model, seed)), place)))
    starts = [np.array(thing.root.pose.p) for _, _, thing in built]
    for _ in range(round(1.5 / TIMESTEP_S)):
        scene.physx_system.step()  # type: ignore[attr-defined]
    for (model, seed, thing), start in zip(built, starts, strict=True):
        moved = float(np.linalg.norm(np.array(thing.root.pose.p) - start))
        assert moved < SETTLED_M, f"{model} {seed} moved {1000 * moved:.2f} mm"
        assert abs(thing.root.pose.q[0]) > 0.9999, f"{model} {seed} tilts"
        body = next(iter(thing.bodies.values()))
        low, high = MASS_KG.get(model, (0.02, 2.0))
        assert low <= body.mass <= high, f"{model} {seed} weighs {body.mass:.3f} kg"


@pytest.mark.slow
def test_joints_move_by_force_to_their_limits_and_back(scene: object) -> None:
    built = []
    for place, (model, seed) in enumerate((m, s) for m in ARTICULATED for s in SEEDS):
        asset = asset_for(sample(model, seed))
        built.append((f"{model} {seed}", asset, _placed(scene, asset, place)))

    def push(newtons: float, seconds: float) -> None:
        for _ in range(round(seconds / TIMESTEP_S)):
            for _, asset, thing in built:
                forces = [newtons + np.sign(newtons) * joint.friction for joint in asset.joints]
                thing.articulation.set_qf(np.array(forces, np.float32))  # type: ignore[union-attr]
            scene.physx_system.step()  # type: ignore[attr-defined]

    for _ in range(250):
        scene.physx_system.step()  # type: ignore[attr-defined]
    for name, _, thing in built:
        assert np.abs(thing.articulation.get_qpos()).max() < SETTLED_M, f"{name} opens by itself"  # type: ignore[union-attr]
    push(12.0, 4.0)
    for name, asset, thing in built:
        for joint, position in zip(asset.joints, thing.articulation.get_qpos(), strict=True):  # type: ignore[union-attr]
            assert 0.98 < joint.fraction(float(position)) < 1.02, f"{name} {joint.name} stands at {position:.3f}"
    for _ in range(250):
        scene.physx_system.step()  # type: ignore[attr-defined]
    for name, asset, thing in built:
        for joint, position in zip(asset.joints, thing.articulation.get_qpos(), strict=True):  # type: ignore[union-attr]
            assert joint.fraction(float(position)) > 0.9, f"{name} {joint.name} shuts by itself"
    push(-12.0, 4.0)
    for name, asset, thing in built:
        for joint, position in zip(asset.joints, thing.articulation.get_qpos(), strict=True):  # type: ignore[union-attr]
            assert abs(joint.fraction(float(position))) < 0.02, f"{name} {joint.name} does not shut"


def _deepest_of(sweep: Sweep) -> tuple[float, str]:
    """The worst overlap with each joint moved alone, and with all of them moved together."""
    joints = sweep.asset.joints
    worst = (1.0, "")
    for fraction in np.linspace(0.0, 1.0, 21):
        states = [{joint.name: joint.position(float(fraction))} for joint in joints]
        states.append({joint.name: joint.position(float(fraction)) for joint in joints})
        for state in states:
            separation, names = sweep.deepest(state)
            worst = min(worst, (separation, f"{names} at {state}"))
    return worst


@pytest.mark.parametrize("model", ARTICULATED)
def test_no_part_overlaps_another_at_any_joint_position(model: str) -> None:
    for seed in SEEDS:
        asset = asset_for(sample(model, seed))
        separation, where = _deepest_of(Sweep(asset, -asset.extent_m[2] / 2 - 5e-4))
        assert separation > DEEPEST_M, f"seed {seed}: {where} overlap by {-1000 * separation:.2f} mm"


def test_the_sweep_finds_a_door_that_is_pushed_into_its_frame() -> None:
    separation, where = Sweep(asset_for(sample("cabinet_one_door", 0))).deepest({"door_hinge": -0.1})
    assert separation < -0.003 and where == "body x door"


def _probe(region: Region) -> Asset:
    """A box that fills a region but for half a millimetre."""
    size = tuple(value - 5e-4 for value in region.half_extents_m)
    return Asset("probe", "dynamic", (Link("probe", (Shape("box", size, region.center_m),)),), (1.0, 1.0, 1.0))


# The bowl's walls slope, and its region is a box between the foot and the rim.
@pytest.mark.parametrize("model", sorted(set(LIBRARY) - {"porcelain_bowl"}))
def test_interiors_and_surfaces_are_free(model: str) -> None:
    for seed in SEEDS:
        asset = asset_for(sample(model, seed))
        offset_of = {joint.child: joint.position_m for joint in asset.joints}
        for region in asset.regions:
            sweep = Sweep(asset)
            shift = np.asarray(offset_of.get(region.link, (0.0, 0.0, 0.0)))
            moved = replace(region, center_m=tuple(float(v) for v in np.asarray(region.center_m) + shift))
            built = build_asset(sweep.scene, "probe", _probe(moved), np.eye(4), visual=False, gravity=False)
            sweep.bodies["probe"] = built.bodies["probe"]
            separation, names = sweep.deepest({})
            assert separation > DEEPEST_M or "probe" not in names, f"{model} {seed}: {region.name}: {names}"


@pytest.mark.parametrize("model", ["mug", "cup", "open_box", "porcelain_bowl", "plate", "bottle", "teddy_bear", "die"])
def test_a_smaller_item_is_smaller_in_every_respect(model: str, scene: object) -> None:
    factor = 0.8  # The engine takes no inertia below 1e-6 kg m2, which a die of 2 cm would have.
    obj = sample(model, 1)
    small = obj.scaled(factor)
    whole, less = asset_for(obj), asset_for(small)
    assert less.extent_m == pytest.approx(tuple(factor * v for v in whole.extent_m))
    assert less.extent_m == pytest.approx(small.extent_m, abs=1e-9)
    bodies = [next(iter(_placed(scene, asset, place).bodies.values())) for place, asset in enumerate((whole, less))]
    assert bodies[1].mass / bodies[0].mass == pytest.approx(factor**3, rel=1e-3)
    assert np.asarray(bodies[1].inertia) / np.asarray(bodies[0].inertia) == pytest.approx(factor**5, rel=1e-3)
    for region, smaller in zip(whole.regions, less.regions, strict=True):
        assert np.prod(smaller.half_extents_m) / np.prod(region.half_extents_m) == pytest.approx(factor**3)
    if whole.graspable_width_m is not None:
        assert less.graspable_width_m == pytest.approx(factor * whole.graspable_width_m)


@pytest.mark.parametrize("model", ["table_four_legs", "fridge_one_door", "red_apple", "tumbler", "porcelain_bowl"])
def test_an_unscaled_asset_is_what_its_builder_returns(model: str) -> None:
    obj = sample(model, 0)
    assert asset_for(obj) == with_resistance(obj, LIBRARY[model].build(obj))


@pytest.mark.parametrize("model", ARTICULATED)
def test_detectors_agree_with_what_was_set_up(model: str, make_world: MakeWorld) -> None:
    die = sample("die", 0, "die_0")
    fixture = replace(sample(model, 0, "fixture_0"))
    world = make_world(
        Scene(
            name="one_fixture",
            robot=RobotPose(position=(-3.0, 0.0, 0.0)),
            objects={"fixture_0": fixture, "die_0": replace(die, position=(3.0, 3.0, die.extent_m[2] / 2))},
        )
    )
    asset = world.assets["fixture_0"]
    settle(world, 0.1)
    assert read(Atom("open", ("fixture_0",)), world).value is False
    for region in asset.regions:
        floor = np.array([*region.center_m[:2], region.center_m[2] - region.half_extents_m[2], 1.0])
        x, y, z = (world.T_world_link("fixture_0", region.link) @ floor)[:3]
        world.set_object_pose("die_0", at(x, y, z + die.extent_m[2] / 2 + 0.001))
        settle(world, 0.3)
        predicate = "inside" if region.kind == "interior" else "ontop"
        assert read(Atom(predicate, ("die_0", "fixture_0")), world).value is True, region.name
    for joint in asset.joints:
        world.set_joint_position("fixture_0", joint.name, joint.position(0.5))
        world.step()
        seen = read(Atom("open", ("fixture_0",)), world)
        assert seen.value is True and seen.measurements.widest_joint == joint.name
        world.set_joint_position("fixture_0", joint.name, joint.limits[0])


def test_joints_have_the_friction_that_is_asked_for_at_their_handles(scene: object) -> None:
    """Read back from the engine: a brake of that force or torque, and nothing of the engine's own."""
    for place, model in enumerate(ARTICULATED):
        drawn = sample(model, 0)
        asset = asset_for(drawn)
        built = _placed(scene, asset, place)
        read_back = {joint.name: joint for joint in built.articulation.active_joints}
        assert set(read_back) == {joint.name for joint in asset.joints} == {handle.joint for handle in asset.handles}
        assert 10.0 <= drawn.parameters["handle_force_n"] <= 30.0
        for handle in asset.handles:
            joint, engine_joint = asset.joint(handle.joint), read_back[handle.joint]
            asked = drawn.parameters["handle_force_n"] * lever_of(joint, handle)
            assert engine_joint.friction == 0.0 and engine_joint.stiffness == 0.0
            assert engine_joint.force_limit == pytest.approx(asked, rel=1e-6), f"{model}, {joint.name}"


@pytest.mark.parametrize("model", ["upright_one_door", "cabinet_drawers", "oven_bottom_hinge", "fridge_freezer_drawer"])
def test_it_takes_the_force_at_the_handle_that_the_object_says(model: str, make_world: MakeWorld) -> None:
    """From shut, the gasket's too; held open a little, the friction alone."""
    drawn = sample(model, 1, "fixture_0")
    world = make_world(Scene(name="fixture", robot=RobotPose(position=(-9.0, 0.0, 0.0)), objects={"fixture_0": drawn}))
    asset, friction_n = world.assets["fixture_0"], float(drawn.parameters["handle_force_n"])
    handle = asset.handles[0]
    joint, links = asset.joint(handle.joint), world.sapien_scene.physx_system.articulation_link_components
    body = next(link for link in links if (link.articulation.name, link.name) == ("fixture_0", handle.link))

    def moved_m(force_n: float, start_m: float) -> float:
        """How far the handle moves in 0.4 s of a pull across its lever."""
        lever = lever_of(joint, handle)
        world.set_joint_position("fixture_0", joint.name, start_m / lever)
        for _ in range(100):
            T = world.T_world_link("fixture_0", handle.link)
            axis, arm = T[:3, :3] @ np.array(joint.axis), T[:3, :3] @ np.array(handle.position_m)
            along = np.cross(axis, arm) / lever if joint.kind == "revolute" else axis
            body.add_force_at_point(force_n * along, T[:3, 3] + arm, "force")
            world.step()
        return world.joint_position("fixture_0", joint.name) * lever - start_m

    gasket_n = float(drawn.parameters.get("gasket_force_n", 0.0))
    for start_m, asked_n in ((0.0, friction_n + gasket_n), (0.05, friction_n)):
        assert moved_m(asked_n - 1.0, start_m) < 0.001
        assert moved_m(asked_n + 1.0, start_m) > 0.003
