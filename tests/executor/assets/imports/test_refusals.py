"""Files that cannot be used end in a sentence that says what to do, and no name leads out of the asset's folder."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import trimesh

from executor.assets.imports.importer import import_asset
from executor.assets.imports.problems import ImportRefused
from tests.executor.assets.imports.conftest import mobility

Spoil = Callable[[str], str]
SPOILED: dict[str, tuple[Spoil, str]] = {
    "not XML": (lambda text: text.replace("</robot>", ""), "not well-formed XML"),
    "other XML": (lambda text: text.replace("robot", "sdf"), "begins with <sdf>"),
    "entities": (lambda text: f'<!DOCTYPE a [<!ENTITY x "y">]>{text}', "has a document type or entities"),
    "mesh missing": (lambda text: text.replace("panel.obj", "panle.obj"), "did you mean textured_objs/panel.obj"),
    "mesh outside": (
        lambda text: text.replace("textured_objs/panel.obj", "../../x.obj"),
        "leads out of the asset's folder",
    ),
    "absolute mesh": (
        lambda text: text.replace("textured_objs/panel.obj", "/etc/hostname"),
        "leads out of the asset's folder",
    ),
    "file address": (lambda text: text.replace("textured_objs/panel", "file:///etc/panel"), "leads out of"),
    "no limits": (lambda text: text.replace('<limit lower="0.0" upper="1.8"/>', ""), "joint_0 has no limits"),
    "limits crossed": (
        lambda text: text.replace('upper="1.8"', 'upper="-1.8"'),
        "limits of joint joint_0 are 0 and -1.8",
    ),
    "zero axis": (lambda text: text.replace('xyz="0 -1 0"', 'xyz="0 0 0"'), "axis of joint joint_0 is zero"),
    "unknown parent": (lambda text: text.replace('<parent link="link_1"/>', '<parent link="x"/>'), "a link 'x'"),
    "floating": (lambda text: text.replace('"revolute"', '"floating"'), "of type 'floating'"),
    "two roots": (lambda text: text.replace("</robot>", '<link name="b"/></robot>'), "2 links that hang on nothing"),
    "not a number": (lambda text: text.replace('xyz="-0.30 0 0.23"', 'xyz="left"'), "no URDF that can be read"),
}


@pytest.mark.parametrize("case", SPOILED)
def test_a_spoiled_urdf_is_refused_with_its_fault(cabinet: Path, case: str) -> None:
    spoil, words = SPOILED[case]
    (cabinet / "mobility.urdf").write_text(spoil(mobility(cabinet)))
    with pytest.raises(ImportRefused) as refusal:
        import_asset(cabinet, "cabinet")
    assert words in str(refusal.value)


def test_a_ring_of_joints_is_refused(cabinet: Path) -> None:
    ring = """<link name="a"/><link name="b"/>
    <joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>
    <joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint></robot>"""
    (cabinet / "mobility.urdf").write_text(mobility(cabinet).replace("</robot>", ring))
    with pytest.raises(ImportRefused, match="make a ring"):
        import_asset(cabinet, "cabinet")


def test_a_gltf_buffer_outside_the_folder_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "secret.bin").write_bytes(b"\0" * 36)
    folder = tmp_path / "asset"
    folder.mkdir()
    gltf = trimesh.exchange.gltf.export_gltf(trimesh.Scene(trimesh.creation.box()))
    text = json.loads(gltf["model.gltf"])
    for buffer in text["buffers"]:
        buffer["uri"] = "../secret.bin"
    (folder / "thing.gltf").write_text(json.dumps(text))
    with pytest.raises(ImportRefused, match="leads out of the asset's folder"):
        import_asset(folder / "thing.gltf", category="toy")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("thing.obj", b"", "thing.obj"),
        ("thing.stl", b"\xff\xfe no mesh", "has no faces"),
        ("thing.txt", b"hello", "of no known kind"),
        ("thing", b"hello", "no ending"),
        (
            "huge.obj",
            b"v 0 0 0\nv 900 0 0\nv 0 900 0\nv 0 0 900\nf 1 2 3\nf 1 2 4\nf 2 3 4\nf 1 3 4\n",
            "give its height",
        ),
        ("nan.obj", b"v 0 0 0\nv nan 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 2 3 4\nf 1 3 4\n", "has no volume"),
    ],
)
def test_a_file_that_is_no_mesh_is_refused(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ImportRefused, match=words):
        import_asset(tmp_path / name, "thing")


@pytest.mark.parametrize(
    ("side", "words"),
    [
        ("{", "Invalid JSON"),
        ('{"colour": "red"}', "colour"),
        ('{"height_m": -1}', "height_m"),
        ('{"category": "rm -rf"}', "category"),
        ('{"handles": [{"joint": "joint_9", "position_m": [0,0,0], "axis": [0,0,1], "outward": [-1,0,0], '
         '"length_m": 0.1, "thickness_m": 0.02}]}', "did you mean joint_0"),
    ],
)  # fmt: skip
def test_a_wrong_side_file_is_refused(cabinet: Path, side: str, words: str) -> None:
    (cabinet / "affordances.json").write_text(side)
    with pytest.raises(ImportRefused, match=words):
        import_asset(cabinet, "cabinet")


def test_a_name_that_is_no_name_is_refused(bottle_mesh: Path) -> None:
    with pytest.raises(ImportRefused, match="is no name"):
        import_asset(bottle_mesh, "../bottle")
    with pytest.raises(ImportRefused, match="no such file or folder"):
        import_asset(bottle_mesh.with_name("none.obj"))
