"""Assets as other people publish them, written anew for every test: a PartNet-Mobility folder, a URDF, meshes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import trimesh

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
WALL = 0.02
# A cabinet 0.5 deep, 0.6 wide, 0.8 high, in the dataset's frame: y is up, the front faces +z, the middle is the origin.
BODY: Mapping[str, Box] = {
    "left": ((-0.30, -0.40, -0.25), (-0.28, 0.40, 0.23)),
    "right": ((0.28, -0.40, -0.25), (0.30, 0.40, 0.23)),
    "back": ((-0.30, -0.40, -0.25), (0.30, 0.40, -0.23)),
    "bottom": ((-0.30, -0.40, -0.25), (0.30, -0.38, 0.23)),
    "shelf": ((-0.30, 0.0, -0.25), (0.30, 0.02, 0.21)),
    "top": ((-0.30, 0.38, -0.25), (0.30, 0.40, 0.23)),
}
PANEL: Box = ((0.002, -0.385, 0.0), (0.598, 0.398, 0.02))
HANDLE: Mapping[str, Box] = {
    "bar": ((0.54, -0.10, 0.065), (0.56, 0.10, 0.085)),
    "post_low": ((0.545, -0.10, 0.02), (0.555, -0.09, 0.07)),
    "post_high": ((0.545, 0.09, 0.02), (0.555, 0.10, 0.07)),
}


@pytest.fixture(autouse=True)
def own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Imported assets go to a folder of the test; decompositions stay in the shared cache."""
    monkeypatch.setenv("SCENE2DEMO_ASSETS", str(tmp_path / "assets"))


@pytest.fixture
def cabinet(tmp_path: Path) -> Path:
    """A PartNet-Mobility folder of a cabinet whose door hangs on the left, with a handle."""
    folder = tmp_path / "45001"
    (folder / "textured_objs").mkdir(parents=True)
    (folder / "meta.json").write_text(json.dumps({"model_cat": "StorageFurniture", "anno_id": "1"}))
    (folder / "mobility.urdf").write_text(mobility(folder))
    return folder


def mobility(folder: Path, limits: tuple[float, float] = (0.0, 1.8), axis: str = "0 -1 0") -> str:
    """Return the text of the cabinet's URDF, and writes its meshes below a folder."""
    body = [("body", write_box(folder, f"body-{name}", box)) for name, box in BODY.items()]
    door = [("door-2", write_box(folder, "panel", PANEL))]
    door += [("handle-3", write_box(folder, f"h{name}", box)) for name, box in HANDLE.items()]
    return f"""<?xml version="1.0" ?>
<robot name="partnet_45001">
  <link name="base"/>
  {_link("link_1", body)}
  {_link("link_0", door)}
  <joint name="joint_1" type="fixed">
    <origin rpy="1.570796326794897 0 -1.570796326794897" xyz="0 0 0"/><parent link="base"/><child link="link_1"/>
  </joint>
  <joint name="joint_0" type="revolute">
    <origin xyz="-0.30 0 0.23"/><axis xyz="{axis}"/><parent link="link_1"/><child link="link_0"/>
    <limit lower="{limits[0]}" upper="{limits[1]}"/>
  </joint>
</robot>
"""


def _link(name: str, parts: list[tuple[str, str]]) -> str:
    visuals = "".join(f'<visual name="{part}">{_mesh(file)}</visual>' for part, file in parts)
    collisions = "".join(f"<collision>{_mesh(file)}</collision>" for _, file in parts)
    return f'<link name="{name}">{visuals}{collisions}</link>'


def _mesh(file: str) -> str:
    return f'<origin xyz="0 0 0"/><geometry><mesh filename="{file}"/></geometry>'


def write_box(folder: Path, name: str, box: Box) -> str:
    """Write a box between two corners as an OBJ and returns its name as a URDF gives it."""
    low, high = np.array(box[0]), np.array(box[1])
    mesh = trimesh.creation.box(extents=high - low)
    mesh.apply_translation((low + high) / 2)
    file = folder / "textured_objs" / f"{name}.obj"
    file.parent.mkdir(parents=True, exist_ok=True)
    mesh.export(file)
    return f"textured_objs/{name}.obj"


@pytest.fixture
def bowl_mesh(tmp_path: Path) -> Path:
    """A bowl 16 cm wide and 6 cm high, open at the top, as an STL in metres."""
    outer = [(0.0, 0.0), (0.05, 0.0), (0.08, 0.06), (0.074, 0.06), (0.046, 0.006), (0.0, 0.006)]
    mesh = trimesh.creation.revolve(np.array(outer), sections=32)
    file = tmp_path / "soup_bowl.stl"
    mesh.export(file)
    return file


@pytest.fixture
def bottle_mesh(tmp_path: Path) -> Path:
    """A bottle 5 cm wide and 16 cm high as a glTF file, whose y axis is up."""
    mesh = trimesh.creation.cylinder(radius=0.025, height=0.16, sections=32)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    file = tmp_path / "water_bottle.glb"
    mesh.export(file)
    return file
