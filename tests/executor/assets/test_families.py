"""Every family: what physics sees fills the object's box exactly, and handles and regions lie where the shapes are."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import llm
from executor.assets.asset_geometry import bounds
from executor.assets.library import FAMILIES, asset_for
from executor.assets.model import Asset, Shape
from executor.assets.parameters import AssetError
from executor.geometry import rotation_z
from executor.scenes.generators.long_horizon import draw
from oag.model.symbols import Kind
from tests.executor.helpers import SIZES, scene_object

FAMILY_NAMES = sorted(SIZES)


@pytest.mark.parametrize("category", FAMILY_NAMES)
@given(factor=st.floats(0.8, 1.3))
@settings(max_examples=8, deadline=None)
def test_collision_shapes_fill_the_object_s_box(category: str, factor: float) -> None:
    x, y, z = SIZES[category]
    obj = scene_object(category, (x * factor, y * factor, z * factor))
    asset = asset_for(obj)
    low, high = bounds(asset)
    assert asset.extent_m == pytest.approx(obj.extent_m)
    # A bowl's wall pieces meet the circle of its rim within half a millimetre.
    assert high == pytest.approx(np.array(obj.extent_m) / 2, abs=6e-4)
    assert low == pytest.approx(-np.array(obj.extent_m) / 2, abs=6e-4)


@pytest.mark.parametrize("category", FAMILY_NAMES)
def test_what_cameras_see_stays_in_the_box(category: str) -> None:
    asset = asset_for(scene_object(category))
    offset_of = {joint.child: np.asarray(joint.position_m) for joint in asset.joints}
    for link in asset.links:
        for shape in link.shapes:
            if shape.kind == "mesh":
                points = np.asarray(shape.vertices_m)
            elif shape.visible and shape.kind == "box":
                signs = np.array(list(itertools.product((-1, 1), repeat=3)))
                points = np.asarray(shape.position_m) + signs * np.asarray(shape.size_m)
            else:
                continue
            points = points + offset_of.get(link.name, np.zeros(3))
            assert np.all(np.abs(points) <= np.asarray(asset.extent_m) / 2 + 1e-6)


@pytest.mark.parametrize("category", FAMILY_NAMES)
def test_meshes_face_outwards(category: str) -> None:
    for shape in (s for link in asset_for(scene_object(category)).links for s in link.shapes if s.kind == "mesh"):
        points, faces = np.asarray(shape.vertices_m), np.asarray(shape.triangles)
        a, b, c = (points[faces[:, corner]] for corner in range(3))
        normals, centers = np.cross(b - a, c - a), (a + b + c) / 3
        assert np.all(np.linalg.norm(normals, axis=1) > 0), "degenerate triangles cannot be shaded"
        flux = float(np.einsum("ij,ij->", normals, centers))
        glaze = category == "bowl" and shape.color[2] > shape.color[0]
        assert flux < 0 if glaze else flux > 0


def _faces(shape: Shape) -> list[tuple[int, float, tuple[float, ...], tuple[float, ...]]]:
    center, half = np.asarray(shape.position_m), np.asarray(shape.size_m)
    faces = []
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        for sign in (-1, 1):
            plane = sign * (center[axis] + sign * half[axis])
            low, high = (tuple((center + s * half)[others]) for s in (-1, 1))
            faces.append((axis * 2 + (sign > 0), float(plane), low, high))
    return faces


@pytest.mark.parametrize("category", FAMILY_NAMES)
def test_no_two_differently_coloured_faces_share_a_plane(category: str) -> None:
    for link in asset_for(scene_object(category)).links:
        boxes = [shape for shape in link.shapes if shape.kind == "box" and shape.visible]
        for first, second in itertools.combinations(boxes, 2):
            if first.color == second.color:
                continue
            for (side_a, plane_a, low_a, high_a), (side_b, plane_b, low_b, high_b) in itertools.product(
                _faces(first), _faces(second)
            ):
                overlap = np.minimum(high_a, high_b) - np.maximum(low_a, low_b)
                fights = side_a == side_b and abs(plane_a - plane_b) < 2e-4 and bool(np.all(overlap > 1e-6))
                assert not fights, f"{first} and {second} are drawn in one plane"


def test_a_scaled_glass_weighs_about_a_hundred_grams() -> None:
    radius, half = 0.07 * 0.71 / 2, 0.12 * 0.71 / 2
    cylinder = next(s for s in asset_for(scene_object("water_glass")).links[0].shapes if s.collides)
    assert math.pi * radius**2 * 2 * half * cylinder.density_kg_m3 == pytest.approx(0.1, rel=0.1)


@pytest.mark.parametrize("category", ["apple", "bowl", "water_glass"])
def test_small_things_roll_little_and_do_not_bounce(category: str) -> None:
    asset = asset_for(scene_object(category))
    assert asset.motion == "dynamic" and asset.symmetric_about_z and asset.angular_damping >= 2.0
    assert all(0.8 <= shape.friction <= 1.0 for shape in asset.links[0].shapes if shape.collides)


def _region_floor_is_a_top(asset: Asset) -> None:
    tops = [
        (shape.position_m[2] + shape.size_m[-1], shape)
        for shape in asset.links[0].shapes
        if shape.collides and shape.kind in ("box", "cylinder")
    ]
    assert asset.regions
    for region in asset.regions:
        floor = region.center_m[2] - region.half_extents_m[2]
        below = [shape for top, shape in tops if abs(top - floor) < 1e-9]
        assert below, f"nothing carries region {region.name}"
        shape = below[0]
        reach = shape.size_m[:2] if shape.kind == "box" else (shape.size_m[0],) * 2
        assert all(abs(region.center_m[axis] - shape.position_m[axis]) <= reach[axis] for axis in (0, 1))


@pytest.mark.parametrize("category", ["refrigerator", "table", "cabinet", "bowl"])
def test_every_region_has_a_floor_to_stand_on(category: str) -> None:
    _region_floor_is_a_top(asset_for(scene_object(category)))


def test_refrigerator_shelves_are_where_the_parameter_says() -> None:
    asset = asset_for(scene_object("refrigerator", shelf_heights_m=[0.4, 0.65, 0.9]))
    floors = [region.center_m[2] - region.half_extents_m[2] + 0.6 for region in asset.regions]
    assert floors[1:] == pytest.approx([0.4, 0.65, 0.9])
    assert [region.name for region in asset.regions] == ["bottom", "shelf_1", "shelf_2", "shelf_3"]
    assert all(region.opening == (-1.0, 0.0, 0.0) and region.joint == "door_hinge" for region in asset.regions)


@pytest.mark.parametrize("hinge", ["left", "right"])
def test_the_door_opens_away_from_the_body_on_either_side(hinge: str) -> None:
    from executor.assets.asset_geometry import joint_transform

    asset = asset_for(scene_object("refrigerator", hinge=hinge))
    (joint,), (handle,) = asset.joints, asset.handles
    shut = joint_transform(joint, 0.0) @ [*handle.position_m, 1.0]
    wide = joint_transform(joint, 1.5) @ [*handle.position_m, 1.0]
    assert wide[0] < shut[0] - 0.3
    side = 1.0 if hinge == "left" else -1.0
    assert side * joint.position_m[1] > 0 > side * shut[1]
    assert side * wide[1] > side * shut[1]


def test_handle_stands_off_far_enough_for_fingers() -> None:
    asset = asset_for(scene_object("refrigerator"))
    (handle,) = asset.handles
    panel = max((s for s in asset.links[1].shapes if s.collides), key=lambda s: float(np.prod(s.size_m)))
    outer = panel.position_m[0] - panel.size_m[0]
    assert outer - handle.position_m[0] == pytest.approx(0.055)
    bar = min(asset.links[1].shapes, key=lambda s: float(np.linalg.norm(np.subtract(s.position_m, handle.position_m))))
    assert 2 * bar.size_m[2] == pytest.approx(handle.length_m)
    assert 2 * bar.size_m[1] == pytest.approx(handle.thickness_m)


def test_bowl_walls_leave_room_inside() -> None:
    asset = asset_for(scene_object("bowl"))
    walls = [shape for shape in asset.links[0].shapes if shape.collides and shape.kind == "box"]
    assert len(walls) >= 14
    (region,) = asset.regions
    for wall in walls:
        inner = math.hypot(*wall.position_m[:2]) - wall.size_m[0]
        assert inner >= region.half_extents_m[0] - 0.004


@pytest.mark.parametrize("category", ["water_glass", "apple"])
def test_bounds_do_not_grow_when_a_round_thing_turns(category: str) -> None:
    asset = asset_for(scene_object(category))
    straight, turned = bounds(asset), bounds(asset, rotation_z(math.pi / 4))
    assert turned[1] == pytest.approx(straight[1])


def test_a_lying_glass_is_as_high_as_it_is_wide() -> None:
    asset = asset_for(scene_object("water_glass"))
    lying = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]) @ rotation_z(math.pi / 4)
    low, high = bounds(asset, lying)
    assert high[2] - low[2] == pytest.approx(0.07)


@pytest.mark.parametrize(
    ("category", "family"), [("bottom_cabinet", "cabinet"), ("breakfast_table", "table"), ("fridge.n.01", "fridge")]
)
def test_the_last_known_word_names_the_family(category: str, family: str) -> None:
    sizes = {"fridge": SIZES["refrigerator"]} | SIZES
    obj = scene_object(category, sizes[family])
    assert asset_for(obj).links == FAMILIES[family](obj).links


def test_unknown_category_names_near_ones() -> None:
    with pytest.raises(AssetError, match=r"refrigerator") as caught:
        asset_for(scene_object("refridgerator", (0.6, 0.6, 1.2)))
    assert "refridgerator_0" in str(caught.value) and "known: apple" in str(caught.value)


@pytest.mark.parametrize(
    ("category", "extent", "parameters", "message"),
    [
        ("refrigerator", None, {"hinge": "top"}, "expected one of left, right"),
        ("refrigerator", None, {"handle_height_m": "high"}, "expected a number from"),
        ("refrigerator", None, {"handle_height_m": True}, "expected a number from"),
        ("refrigerator", None, {"shelf_heights_m": [0.7, 0.4]}, "increasing numbers"),
        ("refrigerator", None, {"shelf_heights_m": 0.4}, "increasing numbers"),
        ("refrigerator", None, {"shelf_heights_m": [1.19]}, "shelves fit from"),
        ("refrigerator", (0.2, 0.6, 1.2), {}, "its x extent is 0.200 m"),
        ("table", None, {"top_thickness_m": 0.5}, "expected a number from"),
        ("bowl", (0.04, 0.04, 0.05), {}, "its x extent is 0.040 m"),
    ],
)
def test_wrong_sizes_and_parameters_are_named(
    category: str, extent: tuple[float, float, float] | None, parameters: dict[str, object], message: str
) -> None:
    with pytest.raises(AssetError, match=message):
        asset_for(scene_object(category, extent, **parameters))


def test_a_wall_is_a_solid_fixture() -> None:
    wall = scene_object("wall", (0.08, 3.0, 2.0))
    asset = asset_for(wall)
    assert wall.kind is Kind.SUPPORT
    assert (asset.motion, asset.handles, asset.regions) == ("static", (), ())
    assert sum(shape.collides for link in asset.links for shape in link.shapes) == 1
    with pytest.raises(AssetError, match=r"its y extent is 0\.100 m"):
        asset_for(scene_object("wall", (0.08, 0.1, 2.0)))


@pytest.mark.parametrize("query", ["open the wall", "pick up the wall", "put the glass on the wall"])
def test_nothing_is_planned_with_a_wall(query: str) -> None:
    with pytest.raises(llm.QueryError):
        llm.propose(query, draw("T1", 12000).scene)
