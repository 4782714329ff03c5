"""Files that cannot be used end in a sentence that says what to do, and no name leads out of the asset's folder."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lxml.etree
import numpy as np
import pytest
import trimesh

from executor.assets.importers.files import ImportRefused
from executor.assets.importers.importer import import_asset
from executor.assets.library import asset_for
from tests.executor.assets.importers.conftest import mobility

Spoil = Callable[[str], str]


def _body(size: str) -> str:
    return f'<link name="base"><visual><geometry><box size="{size}"/></geometry></visual></link>'


SPOILED: dict[str, tuple[Spoil, str]] = {
    "not XML": (lambda text: text.replace("</robot>", ""), "not well-formed XML"),
    "other XML": (lambda text: text.replace("robot", "sdf"), "begins with <sdf>"),
    "entities": (lambda text: f'<!DOCTYPE a [<!ENTITY x "y">]>{text}', "has a document type or entities"),
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
    "limits without end": (
        lambda text: text.replace('upper="1.8"', 'upper="inf"'),
        "are 0 and inf; numbers, lower first",
    ),
    "limits too wide": (
        lambda text: text.replace('upper="1.8"', 'upper="180"'),
        "joint joint_0 opens by 180; at most 6.28 rad make sense",
    ),
    "zero axis": (lambda text: text.replace('xyz="0 -1 0"', 'xyz="0 0 0"'), "axis of joint joint_0 is zero"),
    "unknown parent": (lambda text: text.replace('<parent link="link_1"/>', '<parent link="x"/>'), "a link 'x'"),
    "floating": (lambda text: text.replace('"revolute"', '"floating"'), "of type 'floating'"),
    "two roots": (lambda text: text.replace("</robot>", '<link name="b"/></robot>'), "2 links that hang on nothing"),
    "placed nowhere": (lambda text: text.replace('xyz="-0.30 0 0.23"', 'xyz="nan 0 0"'), "origin or a size that is no"),
    "mesh without a name": (lambda text: text.replace('filename="textured_objs/panel.obj"', ""), "has no filename"),
    "long name": (lambda text: text.replace("panel.obj", "p" * 5000), "letters cannot be read"),
    "no scale": (
        lambda text: text.replace('panel.obj"', 'panel.obj" scale="1 0 1"'),
        "has the scale 1 0 1; expected three numbers other than 0",
    ),
    "no length": (lambda text: text.replace('<link name="base"/>', _body("-1 1 1")), "a box has the size -1 1 1"),
    "a name twice": (lambda text: text.replace("</robot>", '<link name="base"/></robot>'), "2 links called base"),
    "no parent": (lambda text: text.replace('<parent link="link_1"/>', ""), "lacks one that it must have"),
    "no child name": (lambda text: text.replace('<link name="base"/>', "<link/>"), "lacks its attribute 'name'"),
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


def test_a_gltf_that_shows_one_mesh_many_times_is_refused_before_it_is_copied(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = trimesh.Scene()
    ball = trimesh.creation.icosphere(subdivisions=2)
    for i in range(100):
        scene.add_geometry(ball, geom_name="ball", transform=trimesh.transformations.translation_matrix((i, 0, 0)))
    scene.export(tmp_path / "balls.glb")
    monkeypatch.setattr("executor.assets.importers.files.MOST_FACES", 10_000)
    monkeypatch.setattr(trimesh.Scene, "dump", lambda *_, **__: pytest.fail("copies were made"))
    with pytest.raises(ImportRefused, match="has 32000 faces; at most 10000 are read"):
        import_asset(tmp_path / "balls.glb", category="toy")


def test_what_asks_for_more_memory_than_there_is_is_refused(tmp_path: Path) -> None:
    gltf = trimesh.exchange.gltf.export_gltf(trimesh.Scene(trimesh.creation.box()))
    text = json.loads(gltf["model.gltf"])
    for accessor in text["accessors"]:
        del accessor["bufferView"]
        accessor["count"] = 10**16
    (tmp_path / "vast.gltf").write_text(json.dumps(text))
    for name in set(gltf) - {"model.gltf"}:
        (tmp_path / name).write_bytes(gltf[name])
    with pytest.raises(ImportRefused, match="needs more memory than there is"):
        import_asset(tmp_path / "vast.gltf", category="toy")


def test_dust_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    corners = [(x, y, z) for x in range(3) for y in range(3) for z in range(2)]
    dust = [trimesh.creation.box(extents=(0.02,) * 3).apply_translation(np.array(at) * 0.1) for at in corners]
    trimesh.util.concatenate(dust).export(tmp_path / "dust.stl")
    monkeypatch.setattr("executor.assets.importers.importer.MOST_PIECES", 10)
    with pytest.raises(ImportRefused, match="falls into more than 10 solid pieces"):
        import_asset(tmp_path / "dust.stl", category="toy")


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({"height_m": -1.0}, "cannot be -1 m high"),
        ({"height_m": float("nan")}, "cannot be nan m high"),
        ({"category": "Foo Bar/.."}, "'Foo Bar/..' is no category"),
    ],
)
def test_what_is_told_must_make_sense(bottle_mesh: Path, told: dict[str, Any], words: str) -> None:
    with pytest.raises(ImportRefused, match=words):
        import_asset(bottle_mesh, **told)


def test_a_weight_that_cannot_be_is_left_out_and_said_so(tmp_path: Path) -> None:
    file = tmp_path / "thing.urdf"
    heavy = _body("0.05 0.05 0.1").replace("</link>", '<inertial><mass value="nan"/></inertial></link>')
    file.write_text(f'<robot name="thing">{heavy}</robot>')
    imported = import_asset(file, category="toy")
    assert "the mass of link base is nan kg; it was left out" in imported.stored.notes
    assert asset_for(imported.as_object("toy_0")) == imported.stored.asset


def test_whoever_waits_is_told_how_far_it_is(cabinet: Path) -> None:
    told: list[tuple[int, int]] = []
    import_asset(cabinet, "cabinet", on_progress=lambda done, count: told.append((done, count)))
    assert told[0] == (0, 10) and told[-1] == (10, 10) and told == sorted(told)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("thing.obj", b"", "thing.obj"),
        ("thing.stl", b"\xff\xfe no mesh", "has no faces"),
        ("thing.txt", b"hello", "of no known kind"),
        ("thing", b"hello", "no ending"),
        ("side.dae", b"<COLLADA><asset><up_axis>X_UP</up_axis></asset></COLLADA>", "has x up"),
        ("none.dae", b"<COLLADA><asset><unit meter='-1'/></asset></COLLADA>", "has a unit of '-1' metres"),
        ("laughs.dae", b'<!DOCTYPE a [<!ENTITY x "y">]><COLLADA>&x;</COLLADA>', "has a document type or entities"),
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


_BOMB = '<!DOCTYPE a [<!ENTITY x "y">]><COLLADA><asset/>&x;</COLLADA>'
_DECLARED = '<?xml version="1.0" encoding="{}"?>'


@pytest.mark.parametrize("name", ["thing.dae", "thing.urdf"])
@pytest.mark.parametrize(
    ("content", "words"),
    [
        ((_DECLARED.format("UTF-7") + _BOMB.replace("<", "+ADw-").replace(">", "+AD4-")).encode(), "thing"),
        (_DECLARED.format("UTF-16").encode("utf-16") + _BOMB.encode("utf-16"), "is no text"),
        (_DECLARED.format("UTF-16LE").encode("utf-16-le") + _BOMB.encode("utf-16-le"), "is no text"),
        (_DECLARED.format("UTF-32BE").encode("utf-32-be") + _BOMB.encode("utf-32-be"), "is no text"),
        ((_DECLARED.format("IBM037") + _BOMB).encode("cp037"), "is no text"),
    ],
    ids=["UTF-7", "UTF-16", "UTF-16 unmarked", "UTF-32 unmarked", "EBCDIC"],
)
def test_a_declaration_hides_no_entities(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, content: bytes, words: str
) -> None:
    """A parser that followed the declaration would find the entity."""
    seen: list[bytes] = []
    parse = lxml.etree.parse

    def watched(source: Any, parser: Any = None) -> Any:
        tree = parse(source, parser)
        seen.append(lxml.etree.tostring(tree.getroot()) + (tree.docinfo.doctype or "").encode())
        return tree

    monkeypatch.setattr(lxml.etree, "parse", watched)
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ImportRefused, match=words):
        import_asset(tmp_path / name, "thing")
    assert not any(b"DOCTYPE" in text for text in seen)


def test_what_is_declared_counts_for_nothing(tmp_path: Path) -> None:
    body = _body("0.05 0.05 0.1")
    for declared in ('<?xml version="1.0" encoding="UTF-7"?>', '<?xml version="9.9"?>', "\ufeff", "\n<?xml?>"):
        file = tmp_path / "thing.urdf"
        file.write_text(f'{declared}<robot name="thing">{body}</robot>', encoding="utf-8")
        assert import_asset(file, category="toy").stored.kind == "item"


@pytest.mark.parametrize(
    "part", ['<visual name="handle">', '<visual name="handle"><mesh filename="', "<unit ", '<visual name="h" ']
)
def test_many_elements_that_are_not_closed_take_no_time(cabinet: Path, part: str) -> None:
    """With a search from each of them to the end of the file this takes hours."""
    (cabinet / "mobility.urdf").write_text(f"<robot>{part * 200_000}</robot>")
    with pytest.raises(ImportRefused, match="not well-formed XML"):
        import_asset(cabinet, "cabinet")
    (cabinet / "thing.dae").write_text(f"<COLLADA>{part * 200_000}</COLLADA>")
    with pytest.raises(ImportRefused, match=r"thing\.dae"):
        import_asset(cabinet / "thing.dae", "thing")


@pytest.mark.parametrize("name", ["thing.obj", "thing.dae", "thing.urdf"])
def test_a_pipe_is_not_waited_for(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(ImportRefused, match="is no regular file"):
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
