"""Drawers, turned joint frames, lids, doors of either hand, knobs and mirrored meshes come out as they are meant."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from executor.assets.importers.files import AssetFolder, read_mesh
from executor.assets.importers.importer import import_asset
from executor.assets.importers.urdf import read_urdf
from executor.assets.model import Asset
from executor.sim.world import World
from oag import Scene
from oag.model.scene import RobotPose
from tests.executor.assets.importers.drawers import INNER_DEPTH_M, TRAVEL_M, boxes, joint, write_drawers, write_urdf

SHELL = [
    ((-0.25, -0.30, -0.40), (0.25, -0.28, 0.40)),
    ((-0.25, 0.28, -0.40), (0.25, 0.30, 0.40)),
    ((0.23, -0.30, -0.40), (0.25, 0.30, 0.40)),
    ((-0.25, -0.30, -0.40), (0.25, 0.30, -0.38)),
    ((-0.25, -0.30, 0.38), (0.25, 0.30, 0.40)),
]
FRONT = ((-0.27, -0.30, -0.40), (-0.25, 0.30, 0.40))


def test_two_drawers_slide_out_of_the_front_and_carry_what_is_in_them(tmp_path: Path) -> None:
    imported = import_asset(write_drawers(tmp_path / "45135"), "chest_of_drawers")
    asset = imported.stored.asset
    assert asset.category == "cabinet" and len(asset.joints) == len(asset.handles) == 2
    for slide in asset.joints:
        assert slide.kind == "prismatic" and slide.limits == (0.0, TRAVEL_M)
        assert np.allclose(slide.axis, (-1, 0, 0), atol=1e-5)
    heights = []
    for handle in asset.handles:
        slide = next(j for j in asset.joints if j.name == handle.joint)
        assert np.allclose(handle.outward, (-1, 0, 0)) and np.allclose(np.abs(handle.axis), (0, 1, 0))
        assert handle.length_m == pytest.approx(0.24, abs=2e-3) and handle.thickness_m == pytest.approx(0.018, abs=1e-3)
        where = np.add(handle.position_m, slide.position_m)
        assert where[1] == pytest.approx(0.0, abs=2e-3)
        heights.append(where[2])
    assert sorted(heights) == pytest.approx([-0.38 + 0.189, 0.189], abs=3e-3)
    inner = {region.joint: region for region in asset.regions if region.kind == "interior"}
    assert set(inner) == {slide.name for slide in asset.joints}
    for region in inner.values():
        slide = next(j for j in asset.joints if j.name == region.joint)
        assert region.link == slide.child and np.allclose(region.opening, (0, 0, 1))
        floor = slide.position_m[2] + region.center_m[2] - region.half_extents_m[2]
        bottom = -0.38 if floor < 0 else 0.0
        assert floor == pytest.approx(bottom + 0.03, abs=5e-3)
        assert region.half_extents_m[2] * 2 >= INNER_DEPTH_M - 0.015
    with World(
        Scene(name="one", robot=RobotPose((-2.0, 0.0, 0.0)), objects={"c_0": imported.as_object("c_0")})
    ) as world:
        for handle in asset.handles:
            before = (world.T_world_link("c_0", handle.link) @ [*handle.position_m, 1.0])[:3]
            world.set_joint_position("c_0", handle.joint, 0.2)
            after = (world.T_world_link("c_0", handle.link) @ [*handle.position_m, 1.0])[:3]
            assert np.allclose(after - before, (-0.2, 0, 0), atol=1e-4)


def _named(asset: Asset, link: str) -> np.ndarray:
    """Corners (2, 3) of what is solid of a link, in the asset's frame."""
    origin = next((np.array(j.position_m) for j in asset.joints if j.child == link), np.zeros(3))
    shapes = next(part for part in asset.links if part.name == link).shapes
    points = np.concatenate([np.array(shape.vertices_m) for shape in shapes if shape.collides]) + origin
    return np.array([points.min(axis=0), points.max(axis=0)])


def test_a_joint_frame_that_is_turned_moves_nothing_at_zero(tmp_path: Path) -> None:
    asset = import_asset(write_drawers(tmp_path / "45135"), "cabinet").stored.asset
    low, high = (_named(asset, name) for name in ("link_0", "link_1"))
    # The upper drawer's frame is turned; it is the lower one again, 38 cm above.
    assert np.allclose(high - low, [[0, 0, 0.38]] * 2, atol=1e-4)


@pytest.mark.parametrize(("hinge_y", "axis_z"), [(0.30, -1), (-0.30, 1)])
def test_doors_hang_on_either_side(tmp_path: Path, hinge_y: float, axis_z: int) -> None:
    bar = ((-0.33, -hinge_y * 0.8 - 0.01, -0.1), (-0.31, -hinge_y * 0.8 + 0.01, 0.1))
    shifted = [tuple(tuple(np.subtract(c, (-0.25, hinge_y, 0.0))) for c in box) for box in (FRONT, bar)]
    door = boxes("door", shifted)
    file = write_urdf(
        tmp_path, boxes("body", SHELL), door, joint("revolute", "door", f"0 0 {axis_z}", f"-0.25 {hinge_y} 0")
    )
    asset = import_asset(file, category="cabinet").stored.asset
    (hinge,), (handle,) = asset.joints, asset.handles
    assert np.sign(hinge.position_m[1]) == np.sign(hinge_y) and hinge.axis == (0.0, 0.0, float(axis_z))
    assert np.sign(handle.position_m[1]) == -np.sign(hinge_y)
    assert [region.joint for region in asset.regions if region.kind == "interior"] == [hinge.name]


def test_two_doors_before_one_hollow_have_a_half_each(tmp_path: Path) -> None:
    links = [boxes("body", SHELL)]
    for name, hinge_y, axis_z in (("left", 0.30, -1), ("right", -0.30, 1)):
        inner, outer = sorted((0.002 * np.sign(hinge_y), hinge_y))
        panel = ((0.0, inner - hinge_y, -0.40), (-0.02, outer - hinge_y, 0.40))
        corners = np.sort(np.array(panel), axis=0)
        links += [boxes(name, [(tuple(corners[0]), tuple(corners[1]))])]
        links += [joint("revolute", name, f"0 0 {axis_z}", f"-0.25 {hinge_y} 0")]
    asset = import_asset(write_urdf(tmp_path, *links), category="cabinet").stored.asset
    inner = {region.joint: region for region in asset.regions if region.kind == "interior"}
    assert set(inner) == {"left_joint", "right_joint"}
    for name, side in (("left_joint", 1.0), ("right_joint", -1.0)):
        assert side * inner[name].center_m[1] == pytest.approx(0.136, abs=0.01)
        assert inner[name].half_extents_m[1] == pytest.approx(0.134, abs=0.01)


def test_a_chest_opens_upwards_and_its_front_is_away_from_the_hinge(tmp_path: Path) -> None:
    # Its hinge is on the +y side, so that somebody stands at the -y side.
    walls = [
        ((-0.40, -0.25, -0.20), (0.40, -0.23, 0.18)),
        ((-0.40, 0.23, -0.20), (0.40, 0.25, 0.18)),
        ((-0.40, -0.25, -0.20), (-0.38, 0.25, 0.18)),
        ((0.38, -0.25, -0.20), (0.40, 0.25, 0.18)),
        ((-0.40, -0.25, -0.20), (0.40, 0.25, -0.18)),
    ]
    # The lid is not quite over the middle; that is no front.
    lid = boxes("lid", [((-0.42, -0.52, 0.0), (0.40, 0.0, 0.02)), ((-0.06, -0.50, 0.045), (0.06, -0.48, 0.065))])
    file = write_urdf(tmp_path, boxes("body", walls), lid, joint("revolute", "lid", "-1 0 0", "0 0.25 0.18"))
    stored = import_asset(file, category="chest").stored
    asset = stored.asset
    assert "its front faces -y; it was turned to -x" in stored.notes
    (hinge,), (handle,) = asset.joints, asset.handles
    assert hinge.balanced and hinge.position_m[0] > 0.2 and np.allclose(np.abs(hinge.axis), (0, 1, 0))
    # Turning by +90 degrees about the axis brings the lid, which lies towards -x, up.
    assert np.cross(hinge.axis, (-1.0, 0.0, 0.0))[2] > 0.9
    assert handle.outward == (0.0, 0.0, 1.0)
    (interior,) = (region for region in asset.regions if region.kind == "interior")
    assert interior.opening == (0.0, 0.0, 1.0) and interior.joint == hinge.name and interior.link == "body"


@pytest.mark.parametrize("front", ["-x", "+x", "-y", "+y"])
def test_every_front_is_turned_to_minus_x(tmp_path: Path, front: str) -> None:
    """Also when a side file tells it: the axis that pointed to the front points to -x afterwards."""
    axis, sign = "xy".index(front[1]), 1.0 if front[0] == "+" else -1.0
    outward = np.zeros(3)
    outward[axis] = sign
    slide = joint("prismatic", "drawer", " ".join(map(str, outward)), limits=(0.0, 0.3))
    tray = boxes("drawer", [((-0.2, -0.2, -0.2), (0.2, 0.2, 0.2))])
    file = write_urdf(tmp_path, boxes("body", [((-0.3, -0.3, 0.25), (0.3, 0.3, 0.3))]), tray, slide)
    inferred = import_asset(file, category="cabinet").stored.asset
    (tmp_path / "affordances.json").write_text(json.dumps({"front": front}))
    told = import_asset(file, category="cabinet").stored.asset
    for asset in (inferred, told):
        assert np.allclose(asset.joints[0].axis, (-1, 0, 0), atol=1e-6)


def test_a_desk_with_drawers_at_one_side_still_has_its_front_where_they_slide_to(tmp_path: Path) -> None:
    top = ((-0.35, -0.70, 0.35), (0.35, 0.70, 0.38))
    drawer = boxes("drawer", [((-0.30, 0.30, 0.10), (0.30, 0.68, 0.12)), ((0.30, 0.30, 0.10), (0.32, 0.68, 0.34))])
    file = write_urdf(tmp_path, boxes("body", [top]), drawer, joint("prismatic", "drawer", "1 0 0", limits=(0.0, 0.4)))
    notes = import_asset(file, category="cabinet").stored.notes
    assert "its front faces +x; it was turned to -x" in notes


def test_of_two_knobs_one_is_held_and_not_the_air_between_them(tmp_path: Path) -> None:
    knobs = [((-0.31, y - 0.015, -0.015), (-0.27, y + 0.015, 0.015)) for y in (-0.2, 0.2)]
    tray = ((-0.25, -0.27, -0.3), (0.2, 0.27, -0.28))
    drawer = boxes("drawer", [FRONT, tray, *knobs])
    file = write_urdf(tmp_path, boxes("body", SHELL), drawer, joint("prismatic", "drawer", "-1 0 0", limits=(0.0, 0.4)))
    stored = import_asset(file, category="cabinet").stored
    (handle,) = stored.asset.handles
    assert abs(abs(handle.position_m[1]) - 0.2) < 2e-3 and handle.length_m == pytest.approx(0.03, abs=1e-3)
    assert any("the longest of 2" in note for note in stored.notes)


def test_a_handle_that_is_only_seen_becomes_solid(tmp_path: Path) -> None:
    bar = ((-0.33, -0.01, -0.1), (-0.31, 0.01, 0.1))
    drawer = boxes("drawer", [FRONT], seen_only={"handle-7": bar})
    file = write_urdf(tmp_path, boxes("body", SHELL), drawer, joint("prismatic", "drawer", "-1 0 0", limits=(0.0, 0.4)))
    stored = import_asset(file, category="cabinet").stored
    assert len(stored.asset.handles) == 1 and any("has no collision shape" in note for note in stored.notes)
    solid = _named(stored.asset, "drawer")
    assert solid[0][0] == pytest.approx(stored.asset.extent_m[0] / -2, abs=1e-4)


def test_a_table_with_a_drawer_is_one_body(tmp_path: Path) -> None:
    top = ((-0.35, -0.70, 0.35), (0.35, 0.70, 0.38))
    drawer = boxes("drawer", [((-0.30, -0.3, 0.10), (0.30, 0.3, 0.34))])
    file = write_urdf(tmp_path, boxes("body", [top]), drawer, joint("prismatic", "drawer", "-1 0 0", limits=(0.0, 0.4)))
    imported = import_asset(file, category="table")
    asset = imported.stored.asset
    assert asset.joints == asset.handles == () and [link.name for link in asset.links] == ["body"]
    assert {region.link for region in asset.regions} == {"body"}
    assert any("made fast" in note for note in imported.stored.notes)


def test_a_place_of_a_side_file_on_a_drawer_is_in_the_asset_s_frame(tmp_path: Path) -> None:
    folder = write_drawers(tmp_path / "45135")
    place = {"name": "tray", "kind": "interior", "link": "link_1", "center_m": [0.03, 0.0, 0.1],
             "half_extents_m": [0.2, 0.2, 0.05], "opening": [0, 0, 1], "joint": "joint_1"}  # fmt: skip
    (folder / "affordances.json").write_text(json.dumps({"places": [place]}))
    asset = import_asset(folder, "cabinet").stored.asset
    (region,) = asset.regions
    origin = next(j.position_m for j in asset.joints if j.name == "joint_1")
    assert np.allclose(np.add(region.center_m, origin), (0.03, 0.0, 0.1), atol=1e-5)
    assert not np.allclose(origin, 0.0)


@pytest.mark.parametrize("scale", ["0.1 0.2 0.3", "-0.1 0.2 0.3", "-0.1 -0.2 -0.3"])
def test_a_mesh_s_scale_may_mirror_it_and_its_outside_stays_out(tmp_path: Path, scale: str) -> None:
    trimesh.creation.icosphere(subdivisions=1, radius=1.0).export(tmp_path / "ball.obj")
    shape = f'<geometry><mesh filename="ball.obj" scale="{scale}"/></geometry>'
    raw = read_urdf(write_urdf(tmp_path, f'<link name="a"><visual>{shape}</visual></link>'))
    (part,) = raw.links[0].visual_meshes
    mesh = trimesh.Trimesh(part.vertices_m, part.faces)
    assert np.allclose(mesh.extents, (0.2, 0.4, 0.6), atol=1e-6) and mesh.volume > 0.0


@pytest.mark.parametrize("sheet", ["plane", "film"])
def test_what_is_flat_is_not_solid_and_said_so(tmp_path: Path, sheet: str) -> None:
    {
        "plane": trimesh.Trimesh([[0, 0, 0], [0.3, 0, 0], [0.3, 0.3, 0], [0, 0.3, 0]], [[0, 1, 2], [0, 2, 3]]),
        "film": trimesh.creation.box(extents=(0.3, 0.3, 4e-7)),
    }[sheet].export(tmp_path / "sheet.obj")
    shape = '<geometry><mesh filename="sheet.obj"/></geometry>'
    link = boxes("a", [((0.0, 0.0, -0.4), (0.3, 0.3, -0.38))]).replace(
        "</link>", f"<collision>{shape}</collision></link>"
    )
    notes = import_asset(write_urdf(tmp_path, link), category="table").stored.notes
    assert any(note.startswith("1 of its meshes are flat") for note in notes)


def test_sides_that_share_no_edge_are_a_box_together(tmp_path: Path) -> None:
    box = trimesh.creation.box((0.10, 0.12, 0.20))
    sides = [
        box.submesh([np.flatnonzero(box.face_normals @ way > 0.9)], append=True) for way in (*np.eye(3), *-np.eye(3))
    ]
    for side in sides:
        # Each ends a little before its edges, as in many recorded models.
        side.vertices = side.vertices.mean(axis=0) + 0.99 * (side.vertices - side.vertices.mean(axis=0))
    trimesh.util.concatenate(sides).export(tmp_path / "box.obj")
    (shape,) = (shape for shape in import_asset(tmp_path / "box.obj").stored.asset.links[0].shapes if shape.collides)
    assert np.ptp(shape.vertices_m, axis=0) == pytest.approx([0.10, 0.12, 0.20], abs=2e-3)


def test_a_colour_may_be_named_once_for_all(tmp_path: Path) -> None:
    red = '<material name="red"><color rgba="0.8 0.1 0.1 1"/></material>'
    look = '<visual><geometry><box size="0.1 0.1 0.1"/></geometry><material name="red"/></visual>'
    raw = read_urdf(write_urdf(tmp_path, red, f'<link name="a">{look}</link>'))
    assert raw.links[0].visual_meshes[0].color == pytest.approx((0.6038, 0.01, 0.01), abs=1e-4)


@pytest.mark.parametrize(("ending", "linear"), [("glb", (0.2, 0.502, 0.902)), ("obj", (0.0331, 0.216, 0.7913))])
def test_a_mesh_s_colour_is_linear_whatever_its_format_has(
    tmp_path: Path, ending: str, linear: tuple[float, float, float]
) -> None:
    mesh = trimesh.creation.box()
    material = trimesh.visual.material
    look = (
        material.PBRMaterial(baseColorFactor=[51, 128, 230, 255])
        if ending == "glb"
        else material.SimpleMaterial(diffuse=[51, 128, 230, 255])
    )
    mesh.visual = trimesh.visual.TextureVisuals(uv=[[0.0, 0.0]] * len(mesh.vertices), material=look)
    file = tmp_path / f"box.{ending}"
    mesh.export(file)
    (part,) = read_mesh(AssetFolder.of(file), file)
    assert part.color == pytest.approx(linear, abs=1e-3)


def test_a_link_called_after_its_handle_is_not_all_handle(tmp_path: Path) -> None:
    bar = ((-0.33, -0.01, -0.1), (-0.31, 0.01, 0.1))
    drawer = boxes("pull_out", [FRONT, bar])
    file = write_urdf(
        tmp_path, boxes("body", SHELL), drawer, joint("prismatic", "pull_out", "-1 0 0", limits=(0.0, 0.4))
    )
    (handle,) = import_asset(file, category="cabinet").stored.asset.handles
    assert handle.thickness_m == pytest.approx(0.02, abs=1e-3)


@pytest.mark.parametrize(("up", "extent_m"), [("Y_UP", (0.1, 0.3, 0.2)), ("Z_UP", (0.1, 0.2, 0.3))])
def test_a_collada_file_says_what_is_up_and_how_long_its_unit_is(
    tmp_path: Path, up: str, extent_m: tuple[float, float, float]
) -> None:
    text = trimesh.exchange.dae.export_collada(trimesh.creation.box(extents=(10, 20, 30))).decode()
    assert "<up_axis>Y_UP</up_axis>" in text
    told = text.replace("<up_axis>Y_UP</up_axis>", f'<unit name="centimeter" meter="0.01"/><up_axis>{up}</up_axis>')
    (tmp_path / "brick.dae").write_text(told)
    asset = import_asset(tmp_path / "brick.dae", category="block").stored.asset
    assert np.allclose(asset.extent_m, extent_m, atol=1e-6)


def test_a_picture_that_a_mesh_names_is_not_even_opened(tmp_path: Path) -> None:
    (tmp_path / "skin.png").write_bytes(b"no picture")
    (tmp_path / "look.mtl").write_text("newmtl skin\nKd 1 0 0\nmap_Kd skin.png\n")
    box = trimesh.creation.box(extents=(0.05, 0.05, 0.1))
    points = "".join(f"v {x} {y} {z}\n" for x, y, z in box.vertices)
    corners = "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in box.faces)
    (tmp_path / "thing.obj").write_text(f"mtllib look.mtl\n{points}usemtl skin\n{corners}")
    gltf = trimesh.exchange.gltf.export_gltf(trimesh.Scene(box))
    tree = json.loads(gltf["model.gltf"])
    tree["images"], tree["textures"] = [{"uri": "skin.png"}], [{"source": 0}]
    tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    for shape in tree["meshes"]:
        shape["primitives"][0]["material"] = 0
    (tmp_path / "thing.gltf").write_text(json.dumps(tree))
    for name in set(gltf) - {"model.gltf"}:
        (tmp_path / name).write_bytes(gltf[name])
    for name in ("thing.obj", "thing.gltf"):
        assert sorted(import_asset(tmp_path / name, category="toy").stored.asset.extent_m) == [0.05, 0.05, 0.1]


def test_nodes_of_a_gltf_move_turn_stretch_and_mirror_their_meshes(tmp_path: Path) -> None:
    # A box of 0.1 x 0.2 x 0.3 at (1, 0, 0) of a node that is turned by 90 degrees about y (up) and lifted by 0.5, and
    # its mirror image through x.
    scene = trimesh.Scene()
    scene.graph.update(
        "arm", "world", matrix=trimesh.transformations.compose_matrix(angles=(0, np.pi / 2, 0), translate=(0, 0.5, 0))
    )
    box = trimesh.creation.box(extents=(0.1, 0.2, 0.3))
    scene.add_geometry(
        box, node_name="one", parent_node_name="arm", transform=trimesh.transformations.translation_matrix((1, 0, 0))
    )
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirror[0, 3] = 1.0
    scene.add_geometry(box, node_name="two", parent_node_name="arm", transform=mirror)
    scene.export(tmp_path / "arms.glb")
    parts = read_mesh(AssetFolder.of(tmp_path / "arms.glb"), tmp_path / "arms.glb")
    assert len(parts) == 2
    for part in parts:
        low, high = part.vertices_m.min(axis=0), part.vertices_m.max(axis=0)
        # x goes to -z.
        assert np.allclose((low + high) / 2, (0, 0.5, -1), atol=1e-6) and np.allclose(high - low, (0.3, 0.2, 0.1))
        assert trimesh.Trimesh(part.vertices_m, part.faces).volume > 0.0
    asset = import_asset(tmp_path / "arms.glb", category="box").stored.asset
    # y is up in glTF: (x, y, z) is (x, -z, y) here.
    assert np.allclose(asset.extent_m, (0.3, 0.1, 0.2), atol=1e-6)
