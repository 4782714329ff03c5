"""A drawer cabinet as PartNet-Mobility publishes it, and small URDFs put together from boxes, for tests of imports."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from tests.executor.assets.importers.conftest import Box, write_box

# 0.6 wide, 0.8 high, 0.5 deep, in the dataset's frame: y is up, the front faces +z. Two drawers, one above the other.
BODY: Mapping[str, Box] = {
    "left": ((-0.30, -0.40, -0.25), (-0.28, 0.40, 0.23)),
    "right": ((0.28, -0.40, -0.25), (0.30, 0.40, 0.23)),
    "back": ((-0.30, -0.40, -0.25), (0.30, 0.40, -0.23)),
    "bottom": ((-0.30, -0.40, -0.25), (0.30, -0.38, 0.23)),
    "top": ((-0.30, 0.38, -0.25), (0.30, 0.40, 0.23)),
}
TRAVEL_M = 0.35
INNER_DEPTH_M = 0.09


def drawer_parts(bottom_m: float) -> Mapping[str, Box]:
    """Return the boxes of one drawer, by name, for a front that begins at a height; its tray is shallow."""
    low, high = bottom_m + 0.02, bottom_m + 0.02 + 0.01 + INNER_DEPTH_M
    middle = bottom_m + 0.18
    return {
        "floor": ((-0.27, low, -0.22), (0.27, low + 0.01, 0.23)),
        "side_l": ((-0.27, low, -0.22), (-0.26, high, 0.23)),
        "side_r": ((0.26, low, -0.22), (0.27, high, 0.23)),
        "rear": ((-0.27, low, -0.22), (0.27, high, -0.21)),
        "front": ((-0.295, bottom_m, 0.23), (0.295, bottom_m + 0.37, 0.25)),
        "handle_bar": ((-0.12, middle, 0.295), (0.12, middle + 0.018, 0.313)),
        "handle_post_l": ((-0.12, middle, 0.25), (-0.11, middle + 0.018, 0.30)),
        "handle_post_r": ((0.11, middle, 0.25), (0.12, middle + 0.018, 0.30)),
    }


def write_drawers(folder: Path) -> Path:
    """Write the cabinet's folder and returns it.

    The upper drawer's joint has an origin of its own, turned by a quarter about the vertical axis, as conversions make
    them: its axis, and where its meshes are, are given in that turned frame.
    """
    (folder / "textured_objs").mkdir(parents=True)
    (folder / "meta.json").write_text(json.dumps({"model_cat": "StorageFurniture"}))
    body = "".join(_element(folder, f"body_{name}", name, box) for name, box in BODY.items())
    lower = "".join(_element(folder, f"low_{name}", name, box) for name, box in drawer_parts(-0.38).items())
    # x_in = -z, z_in = x of the outer frame, after the shift.
    unturned = '<origin xyz="0 0 0" rpy="0 -1.5707963267948966 0"/>'
    upper = "".join(
        _element(folder, f"high_{name}", name, _shifted(box, (0.0, -0.1, -0.2)), unturned)
        for name, box in drawer_parts(0.0).items()
    )
    (folder / "mobility.urdf").write_text(f"""<?xml version="1.0" ?>
<robot name="partnet_45135">
  <link name="base"/><link name="link_2">{body}</link>
  <link name="link_0">{lower}</link><link name="link_1">{upper}</link>
  <joint name="joint_2" type="fixed"><origin rpy="1.570796326794897 0 -1.570796326794897" xyz="0 0 0"/>
    <parent link="base"/><child link="link_2"/></joint>
  <joint name="joint_0" type="prismatic"><origin xyz="0 0 0"/><axis xyz="0 0 1"/>
    <parent link="link_2"/><child link="link_0"/><limit lower="0" upper="{TRAVEL_M}"/></joint>
  <joint name="joint_1" type="prismatic"><origin xyz="0 0.1 0.2" rpy="0 1.5707963267948966 0"/><axis xyz="1 0 0"/>
    <parent link="link_2"/><child link="link_1"/><limit lower="-{TRAVEL_M}" upper="0"/></joint>
</robot>
""")
    return folder


def _shifted(box: Box, by_m: Sequence[float]) -> Box:
    low, high = (tuple(float(a + b) for a, b in zip(corner, by_m, strict=True)) for corner in box)
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


def _element(folder: Path, file: str, part: str, box: Box, origin: str = "") -> str:
    shape = f'{origin}<geometry><mesh filename="{write_box(folder, file, box)}"/></geometry>'
    label = f"handle-{part}" if part.startswith("handle") else f"part-{part}"
    return f'<visual name="{label}">{shape}</visual><collision>{shape}</collision>'


def boxes(name: str, parts: Sequence[Box], *, seen_only: Mapping[str, Box] | None = None) -> str:
    """Return a URDF link of boxes that are solid and seen, and of named ones that are only seen."""
    whole = "".join(f"<visual>{_box(box)}</visual><collision>{_box(box)}</collision>" for box in parts)
    seen = "".join(f'<visual name="{label}">{_box(box)}</visual>' for label, box in (seen_only or {}).items())
    return f'<link name="{name}">{whole}{seen}</link>'


def joint(kind: str, child: str, axis: str, origin: str = "0 0 0", limits: tuple[float, float] = (0.0, 1.5)) -> str:
    """Return a URDF joint between `body` and another link."""
    return (
        f'<joint name="{child}_joint" type="{kind}"><origin xyz="{origin}"/><axis xyz="{axis}"/><parent link="body"/>'
        f'<child link="{child}"/><limit lower="{limits[0]}" upper="{limits[1]}"/></joint>'
    )


def write_urdf(folder: Path, *elements: str) -> Path:
    """Write a URDF of elements and returns its file."""
    file = folder / "thing.urdf"
    file.write_text(f'<robot name="thing">{"".join(elements)}</robot>')
    return file


def _box(box: Box) -> str:
    low, high = np.array(box[0]), np.array(box[1])
    x, y, z = (low + high) / 2
    dx, dy, dz = high - low
    return f'<origin xyz="{x} {y} {z}"/><geometry><box size="{dx} {dy} {dz}"/></geometry>'
