"""Other people's files become assets whose handles, hollows and widths are where a person would say that they are."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from executor.assets.importers.importer import import_asset
from executor.assets.importers.store import Imported, names
from executor.assets.library import asset_for
from executor.assets.parameters import AssetError
from executor.sim.world import World
from oag import Scene, SceneObject
from oag.model.scene import RobotPose
from tests.executor.assets.importers.conftest import mobility, write_box


def test_a_partnet_cabinet_has_a_door_a_handle_and_two_hollows(cabinet: Path) -> None:
    asset = import_asset(cabinet, "cabinet_45001").stored.asset
    assert asset.category == "cabinet" and asset.motion == "articulated"
    # The handle stands out by 8.5 cm from the front of the body.
    assert np.allclose(asset.extent_m, (0.25 + 0.23 + 0.085, 0.60, 0.80), atol=1e-3)
    (door,) = asset.joints
    assert door.kind == "revolute" and door.limits == (0.0, 1.8)
    # The hinge is on the left of somebody who faces the front, which is +y; turning about -z opens such a door.
    assert np.allclose(door.axis, (0, 0, -1)) and door.position_m[1] == pytest.approx(0.30, abs=1e-3)
    (handle,) = asset.handles
    assert handle.joint == door.name and np.allclose(handle.outward, (-1, 0, 0))
    assert np.allclose(np.abs(handle.axis), (0, 0, 1)) and handle.length_m == pytest.approx(0.20, abs=5e-3)
    assert handle.thickness_m == pytest.approx(0.02, abs=1e-3)
    in_root = np.asarray(handle.position_m) + np.asarray(door.position_m)
    assert in_root[1] == pytest.approx(-0.25, abs=5e-3) and abs(in_root[2]) < 5e-3
    interiors = [region for region in asset.regions if region.kind == "interior"]
    assert len(interiors) == 2 and all(region.joint == door.name for region in interiors)
    floors = sorted(region.center_m[2] - region.half_extents_m[2] for region in interiors)
    assert np.allclose(floors, (-0.38, 0.02), atol=0.004)
    assert all(np.allclose(region.opening, (-1, 0, 0)) for region in interiors)
    (top,) = (region for region in asset.regions if region.kind == "surface")
    assert top.center_m[2] - top.half_extents_m[2] == pytest.approx(0.40, abs=0.004)


@pytest.mark.parametrize(("limits", "axis"), [((-1.8, 0.0), "0 1 0"), ((0.0, 1.8), "0 -1 0"), ((-0.2, 1.8), "0 -1 0")])
def test_doors_open_in_the_positive_direction_whatever_the_file_says(
    cabinet: Path, limits: tuple[float, float], axis: str
) -> None:
    (cabinet / "mobility.urdf").write_text(mobility(cabinet, limits, axis))
    stored = import_asset(cabinet, "cabinet").stored
    (door,) = stored.asset.joints
    assert np.allclose(door.axis, (0, 0, -1)) and door.limits == (0.0, 1.8)
    assert any("goes both ways" in note for note in stored.notes) == (limits[0] < 0 < limits[1])


def test_the_door_swings_out_of_the_body_in_the_physics(cabinet: Path) -> None:
    obj = import_asset(cabinet, "cabinet").as_object("cabinet_0")
    with World(Scene(name="one", robot=RobotPose((-2.0, 0.0, 0.0)), objects={"cabinet_0": obj})) as world:
        (handle,) = world.assets["cabinet_0"].handles
        shut = world.T_world_link("cabinet_0", handle.link) @ np.array([*handle.position_m, 1.0])
        for _ in range(5):
            world.step()
        world.set_joint_position("cabinet_0", handle.joint, np.pi / 2)
        opened = world.T_world_link("cabinet_0", handle.link) @ np.array([*handle.position_m, 1.0])
        # A quarter turn brings the handle from the far side of the front to straight before the hinge.
        assert opened[0] < shut[0] - 0.4 and opened[1] > shut[1] + 0.4


def test_a_knob_on_a_door_is_made_fast_and_said_so(cabinet: Path) -> None:
    knob = write_box(cabinet, "knob", ((0.5, 0.2, 0.02), (0.52, 0.22, 0.06)))
    text = (cabinet / "mobility.urdf").read_text()
    extra = f"""<link name="knob_link"><visual><geometry><mesh filename="{knob}"/></geometry></visual>
      <collision><geometry><mesh filename="{knob}"/></geometry></collision></link>
      <joint name="turn" type="revolute"><parent link="link_0"/><child link="knob_link"/><axis xyz="0 0 1"/>
      <limit lower="0" upper="1"/></joint></robot>"""
    (cabinet / "mobility.urdf").write_text(text.replace("</robot>", extra))
    stored = import_asset(cabinet, "cabinet").stored
    assert len(stored.asset.joints) == 1
    assert any("joint turn" in note and "made fast" in note for note in stored.notes)


def test_a_bowl_mesh_has_a_hollow_that_things_lie_in(bowl_mesh: Path) -> None:
    asset = import_asset(bowl_mesh).stored.asset
    assert asset.category == "soup_bowl" and asset.motion == "dynamic" and asset.symmetric_about_z
    assert np.allclose(asset.extent_m, (0.16, 0.16, 0.06), atol=1e-3)
    (hollow,) = asset.regions
    assert hollow.kind == "interior" and np.allclose(hollow.opening, (0, 0, 1))
    assert hollow.center_m[2] - hollow.half_extents_m[2] == pytest.approx(-0.03 + 0.006, abs=0.006)
    assert 0.03 < hollow.half_extents_m[0] < 0.07


def test_a_gltf_bottle_stands_and_fits_between_the_fingers(bottle_mesh: Path) -> None:
    asset = import_asset(bottle_mesh).stored.asset
    assert np.allclose(asset.extent_m, (0.05, 0.05, 0.16), atol=1e-3)
    assert asset.graspable_width_m == pytest.approx(0.05, abs=1e-3) and asset.symmetric_about_z


def test_its_size_can_be_told(bottle_mesh: Path) -> None:
    asset = import_asset(bottle_mesh, height_m=0.08).stored.asset
    assert np.allclose(asset.extent_m, (0.025, 0.025, 0.08), atol=1e-3)


def test_a_side_file_overrules_what_is_inferred(cabinet: Path) -> None:
    told = {
        "category": "wardrobe",
        "handles": [
            {
                "joint": "joint_0",
                "position_m": [-0.3, -0.25, 0.1],
                "axis": [0, 0, 2],
                "outward": [-1, 0, 0],
                "length_m": 0.1,
                "thickness_m": 0.02,
            }
        ],
        "places": [],
    }
    (cabinet / "affordances.json").write_text(json.dumps(told))
    asset = import_asset(cabinet, "wardrobe").stored.asset
    assert asset.category == "wardrobe" and asset.regions == ()
    (handle,) = asset.handles
    assert handle.axis == (0.0, 0.0, 1.0) and handle.length_m == 0.1


def _as_object(imported: Imported, **changes: object) -> SceneObject:
    return replace(imported.as_object("thing_0"), **changes)


def test_scenes_name_it_and_get_it_at_their_size(bottle_mesh: Path) -> None:
    imported = import_asset(bottle_mesh, "flask", category="bottle")
    assert names() == ("flask",)
    whole = asset_for(_as_object(imported))
    half = asset_for(_as_object(imported, scale=(0.5, 0.5, 0.5)))
    assert half.extent_m == pytest.approx(tuple(value / 2 for value in whole.extent_m))
    assert half.graspable_width_m == pytest.approx(0.025, abs=1e-3)


def test_what_a_scene_cannot_mean_is_refused(bottle_mesh: Path) -> None:
    imported = import_asset(bottle_mesh, "flask", category="bottle")
    with pytest.raises(AssetError, match="did you mean imported/flask"):
        asset_for(_as_object(imported, model="imported/flash"))
    with pytest.raises(AssetError, match="stretches the asset"):
        asset_for(_as_object(imported, bbox_extent=(0.05, 0.05, 0.30)))
    with pytest.raises(AssetError, match="not the asset that the scene was made with"):
        asset_for(_as_object(imported, parameters={"content": "0" * 16}))
    with pytest.raises(AssetError, match="is item, a cabinet is articulated"):
        asset_for(_as_object(imported, category="cabinet"))
    with pytest.raises(AssetError, match="was imported"):
        asset_for(_as_object(imported, model="imported/../../secrets"))


def test_what_is_imported_may_be_fixed_to_the_room_and_its_joints_resist_as_before(cabinet: Path) -> None:
    obj = import_asset(cabinet, "cabinet_45001").as_object("cabinet_0")
    free, fixed = asset_for(obj), asset_for(replace(obj, fixed=True))
    assert fixed.joints == free.joints and all(joint.friction > 0.0 for joint in fixed.joints)
    assert not fixed.handles and not fixed.regions


def test_importing_twice_gives_the_same_asset(cabinet: Path) -> None:
    first, second = import_asset(cabinet, "one"), import_asset(cabinet, "two")
    assert first.stored.content == second.stored.content
