"""Joints that cannot be meant are named: hardly any range, into the body, sideways, followers, knobs, fixed fronts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from executor.assets.importers.files import ImportRefused
from executor.assets.importers.importer import import_asset
from executor.assets.importers.store import StoredAsset
from executor.assets.model import LEAST_TRAVEL
from executor.cli import app
from executor.scenes.file import load_scene
from tests.executor.assets.importers.drawers import boxes, joint, write_urdf

SHELL = [
    ((-0.25, -0.30, -0.40), (0.25, -0.28, 0.40)),
    ((-0.25, 0.28, -0.40), (0.25, 0.30, 0.40)),
    ((0.23, -0.30, -0.40), (0.25, 0.30, 0.40)),
    ((-0.25, -0.30, -0.40), (0.25, 0.30, -0.38)),
    ((-0.25, -0.30, 0.38), (0.25, 0.30, 0.40)),
]
HINGE = "-0.26 -0.30 0"  # On the right of somebody who faces the front, which is -x: turning about +z opens it.
DOOR = [((-0.01, 0.0, -0.40), (0.01, 0.60, 0.40)), ((-0.06, 0.5, -0.12), (-0.04, 0.52, 0.12))]
POSTS = [((-0.05, 0.5, z), (-0.01, 0.52, z + 0.01)) for z in (-0.12, 0.11)]
TRAY = [
    ((-0.22, -0.26, -0.1), (0.2, 0.26, -0.09)),
    ((0.19, -0.26, -0.1), (0.2, 0.26, 0.1)),
    ((-0.27, -0.29, -0.15), (-0.25, 0.29, 0.15)),
    ((-0.32, -0.1, -0.01), (-0.30, 0.1, 0.01)),
]


def imported(folder: Path, *elements: str, body: str = "") -> StoredAsset:
    return import_asset(write_urdf(folder, body or boxes("body", SHELL), *elements), "thing", category="cabinet").stored


def door(kind: str = "revolute", axis: str = "0 0 1", limits: tuple[float, float] = (0.0, 1.6)) -> list[str]:
    return [boxes("door", [*DOOR, *POSTS]), joint(kind, "door", axis, HINGE, limits)]


def warned(stored: StoredAsset) -> list[str]:
    return [note.removeprefix("warning: ") for note in stored.notes if note.startswith("warning: ")]


def test_a_door_that_is_right_has_no_warning(tmp_path: Path) -> None:
    stored = imported(tmp_path, *door())
    assert warned(stored) == [] and len(stored.asset.handles) == 1
    assert [region.kind for region in stored.asset.regions] == ["interior", "surface"]


@pytest.mark.parametrize(
    ("kind", "limits", "said"),
    [
        ("revolute", (0.0, 0.02), "joint door_joint moves by 1.1 degrees only; it was made fast"),
        ("revolute", (-0.03, 0.01), "joint door_joint moves by 1.7 degrees only; it was made fast"),
        ("revolute", (0.5, 0.5), "joint door_joint has no range; it was made fast"),
        ("prismatic", (0.0, 0.004), "joint door_joint moves by 4 mm only; it was made fast"),
    ],
)
def test_a_joint_that_hardly_moves_is_made_fast(
    kind: str, limits: tuple[float, float], said: str, tmp_path: Path
) -> None:
    stored = imported(tmp_path, *door(kind, "-1 0 0" if kind == "prismatic" else "0 0 1", limits))
    assert warned(stored) == [said] and stored.asset.joints == ()


def test_what_opens_a_little_is_a_warning(tmp_path: Path) -> None:
    stored = imported(tmp_path, *door(limits=(0.0, 0.6)))
    assert warned(stored) == ["joint door_joint opens by 34 degrees only"] and len(stored.asset.joints) == 1


@pytest.mark.parametrize(
    ("axis", "limits"),
    [("0 0 -1", (0.0, 1.6)), ("0 0 1", (-1.6, 0.0)), ("0 0 -3", (0.0, 1.6)), ("0 0 -1", (-0.1, 1.6))],
)
def test_a_door_into_its_own_body_opens_outwards_with_a_warning(
    axis: str, limits: tuple[float, float], tmp_path: Path
) -> None:
    stored = imported(tmp_path, *door(axis=axis, limits=limits))
    said = "joint door_joint swings door into the body: its sign was turned, so that it opens outwards"
    assert warned(stored) == [said]
    (hinge,) = stored.asset.joints
    assert np.allclose(hinge.axis, (0, 0, 1)) and hinge.limits == (0.0, 1.6)


def test_a_door_that_goes_both_ways_opens_outwards(tmp_path: Path) -> None:
    stored = imported(tmp_path, *door(limits=(-1.7, 1.5)))
    (hinge,) = stored.asset.joints
    assert np.allclose(hinge.axis, (0, 0, 1)) and hinge.limits == (0.0, 1.5)
    assert any(note.endswith("it opens out of the body") for note in stored.notes) and not warned(stored)


@pytest.mark.parametrize("hinge", ["front", "top"])
def test_lids_and_folding_doors_open_outwards_too(hinge: str, tmp_path: Path) -> None:
    if hinge == "front":  # Hinged below, as an oven's door: about -y it folds down.
        panel = boxes("flap", [((-0.01, -0.3, 0.0), (0.01, 0.3, 0.8))])
        good, bad, origin = "0 -1 0", "0 1 0", "-0.26 0 -0.4"
    else:
        panel = boxes("flap", [((-0.5, -0.3, -0.01), (0.0, 0.3, 0.01))])
        good, bad, origin = "0 1 0", "0 -1 0", "0.25 0 0.41"
    assert not warned(imported(tmp_path, panel, joint("revolute", "flap", good, origin)))
    (said,) = warned(imported(tmp_path, panel, joint("revolute", "flap", bad, origin)))
    assert "swings flap into the body" in said


def test_a_door_whose_axis_is_left_out_turns_in_its_own_plane(tmp_path: Path) -> None:
    elements = [element.replace('<axis xyz="0 0 1"/>', "") for element in door()]
    stored = imported(tmp_path, *elements)
    assert stored.asset.joints == () and "turns door in its own plane" in warned(stored)[0]


def test_a_drawer_slides_out_of_the_front_whatever_its_sign(tmp_path: Path) -> None:
    drawer = boxes("drawer", TRAY)
    good = imported(tmp_path, drawer, joint("prismatic", "drawer", "-1 0 0", limits=(0.0, 0.3)))
    assert not warned(good)
    for axis, limits in (("1 0 0", (0.0, 0.3)), ("-1 0 0", (-0.3, 0.0))):
        stored = imported(tmp_path, drawer, joint("prismatic", "drawer", axis, limits=limits))
        (said,) = warned(stored)
        assert said.startswith("joint drawer_joint slides drawer into the body after 30 of 300 mm: its sign was turned")
        assert stored.asset == good.asset


def test_a_drawer_with_no_way_out_is_made_fast(tmp_path: Path) -> None:
    drawer = boxes("drawer", TRAY[:2])
    closed = boxes("body", [*SHELL, ((-0.30, -0.30, -0.40), (-0.25, 0.30, 0.40))])
    stored = imported(tmp_path, drawer, joint("prismatic", "drawer", "-1 0 0", limits=(0.0, 0.3)), body=closed)
    assert stored.asset.joints == () and "there is no other way; it was made fast" in warned(stored)[0]


def test_a_sliding_door_faces_across_its_panel(tmp_path: Path) -> None:
    for axis in ("0 1 0", "0 -1 0", "0 0 1"):
        stored = imported(tmp_path, *door("prismatic", axis, (0.0, 0.5)))
        assert not any("its front faces" in note for note in stored.notes) and not warned(stored)
        (handle,) = stored.asset.handles
        assert handle.outward == (-1.0, 0.0, 0.0)
        interior = next(region for region in stored.asset.regions if region.kind == "interior")
        assert interior.joint == "door_joint" and interior.link == "body" and interior.opening == (-1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("parts", "front"),
    [
        ([((-0.24, -0.06, -0.3), (0.2, 0.06, 0.3)), ((-0.27, -0.08, -0.35), (-0.25, 0.08, 0.35))], "pull-out"),
        ([((-0.27, -0.25, 0.0), (0.2, 0.25, 0.02))], "keyboard tray"),
    ],
)
def test_a_narrow_pull_out_and_a_tray_face_where_they_slide_to(
    parts: list[tuple[tuple[float, float, float], tuple[float, float, float]]], front: str, tmp_path: Path
) -> None:
    stored = imported(tmp_path, boxes("out", parts), joint("prismatic", "out", "-1 0 0", limits=(0.0, 0.3)))
    assert np.allclose(stored.asset.joints[0].axis, (-1, 0, 0)), front


def test_what_follows_another_joint_decides_nothing(tmp_path: Path) -> None:
    lever = boxes("lever", [((-0.01, 0.0, 0.0), (0.01, 0.2, 0.1))])
    follows = joint("revolute", "lever", "1 0 0", "0 0.30 0.2").replace(
        "</joint>", '<mimic joint="door_joint" multiplier="-1"/></joint>'
    )
    stored = imported(tmp_path, *door(), lever, follows)
    assert warned(stored) == [
        "joint lever_joint follows door_joint (mimic), and here nothing moves by itself; it was made fast"
    ]
    assert [one.name for one in stored.asset.joints] == ["door_joint"]
    assert not any("its front faces" in note for note in stored.notes)


def test_knobs_on_the_body_are_no_doors(tmp_path: Path) -> None:
    knobs = []
    for number in range(3):
        name = f"dial_{number}"
        at = f"{0.1 * number} 0.31 0.2"
        knobs += [boxes(name, [((-0.02, -0.02, -0.02), (0.02, 0.02, 0.02))]), joint("revolute", name, "0 1 0", at)]
    stored = imported(tmp_path, *door(), *knobs)
    assert [one.name for one in stored.asset.joints] == ["door_joint"]
    assert [said.split(";")[0] for said in warned(stored)] == [
        f"joint dial_{number}_joint turns dial_{number} about its own middle: a knob, no door" for number in range(3)
    ]
    assert not any("its front faces" in note for note in stored.notes)


def test_a_front_that_is_fixed_is_a_warning(tmp_path: Path) -> None:
    fixed = joint("fixed", "drawer_2", "0 0 1").replace('<limit lower="0.0" upper="1.5"/>', "")
    drawer = boxes("drawer_2", [((-0.27, -0.3, -0.4), (-0.25, 0.3, 0.0))])
    stored = imported(tmp_path, drawer, fixed)
    assert warned(stored) == [
        "joint drawer_2_joint is fixed, and drawer_2 looks like a door or a drawer: it will not open"
    ]


def test_a_door_heavier_than_its_body_is_a_warning(tmp_path: Path) -> None:
    heavy, hinge = door()
    mass = '<inertial><mass value="{}"/></inertial></link>'
    body = boxes("body", SHELL).replace("</link>", mass.format(5))
    stored = imported(tmp_path, heavy.replace("</link>", mass.format(40)), hinge, body=body)
    assert warned(stored) == ["door weighs 40 kg, its body 5 kg; here their sum is spread by volume"]


@pytest.mark.parametrize(("high", "rad"), [(90, "1.57"), (120, "2.09")])
def test_limits_in_degrees_are_refused_with_the_number_in_radians(high: float, rad: str, tmp_path: Path) -> None:
    with pytest.raises(
        ImportRefused, match=f"opens by {high}; at most 6.28 rad make sense; {high} degrees are {rad} rad"
    ):
        imported(tmp_path, *door(limits=(0.0, high)))


def test_nothing_plans_with_a_door_that_hardly_opens(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Also not with one that was imported before such doors were made fast."""
    stored = import_asset(write_urdf(tmp_path, boxes("body", SHELL), *door()), "stiff", category="cabinet")
    text, limits = stored.path.read_text(), f"{list(stored.stored.asset.joints[0].limits)}".replace(" ", "")
    assert text.count(limits) == 1
    stored.path.write_text(text.replace(limits, f"[0.0,{LEAST_TRAVEL['revolute'] / 10}]"))
    scene = tmp_path / "scene.json"
    entry = '{"category": "cabinet", "model": "imported/stiff", "position": [1.2, 0.0]}'
    scene.write_text(f'{{"objects": {{"cabinet_0": {entry}}}}}')
    assert load_scene(scene)
    assert app.run(["plan", "open the cabinet", "--scene", str(scene)]) == 1
    assert "a handle of cabinet_0 moves too little to open anything" in capsys.readouterr().out


def mesh(name: str) -> str:
    shape = f'<geometry><mesh filename="{name}"/></geometry>'
    return f"<visual>{shape}</visual><collision>{shape}</collision></link>"


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("meshes/gone.stl", None, "no such file; the folder must have all files that the asset names"),
        ("package://kitchen/meshes/there.stk", None, "no such file; did you mean meshes/there.stl?"),
        ("empty.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
         "end_header\n0 0 0\n", "has no faces; export it with triangles"),
    ],
)  # fmt: skip
def test_a_mesh_that_is_not_there_or_has_no_faces_is_left_out(
    name: str, content: str | None, why: str, tmp_path: Path
) -> None:
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "meshes" / "there.stl")
    if content is not None:
        (tmp_path / name).write_text(content)
    body = boxes("body", SHELL).replace("</link>", mesh(name))
    stored = imported(tmp_path, *door(), body=body)
    assert warned(stored) == [f"mesh {name} was left out: {why}"] and stored.asset.joints


def test_a_part_of_missing_meshes_alone_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ImportRefused, match="link door moves and has no shape"):
        imported(tmp_path, f'<link name="door">{mesh("gone.obj")}', joint("revolute", "door", "0 0 1", HINGE))


def test_a_package_that_is_not_there_is_refused_with_what_to_do(tmp_path: Path) -> None:
    uri = "package://my_kitchen/meshes/top.dae"
    with pytest.raises(ImportRefused) as caught:
        imported(tmp_path, body=boxes("body", SHELL).replace("</link>", mesh(uri)))
    told = "copy the package's folder 'my_kitchen' into this one, so that there is my_kitchen/meshes/top.dae"
    assert f"{tmp_path}: {uri} is not there; {told}" in str(caught.value)


def test_xacro_is_refused_with_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(ImportRefused, match=r"no URDF yet; expand it first: xacro thing\.urdf > thing_expanded\.urdf"):
        imported(tmp_path, *door(), body=boxes("body", SHELL).replace('"0.5 ', '"${depth} '))
