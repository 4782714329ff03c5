"""Reads a PartNet-Mobility folder: its URDF, with what its other files say of category and handles."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from executor.assets.imports.folder import AssetFolder
from executor.assets.imports.markup import parsed_markup
from executor.assets.imports.problems import ImportRefused
from executor.assets.imports.raw import RawAsset
from executor.assets.imports.side_file import CATEGORY
from executor.assets.imports.urdf import is_handle_name, read_urdf

MAIN_FILE = "mobility.urdf"
# Its words for things, in ours.
_CATEGORIES = {
    "Box": "box",
    "Bottle": "bottle",
    "Dishwasher": "dishwasher",
    "Microwave": "microwave",
    "Mug": "mug",
    "Oven": "oven",
    "Refrigerator": "refrigerator",
    "StorageFurniture": "cabinet",
    "Table": "table",
}


def is_partnet(folder: Path) -> bool:
    """Decides whether a folder is one of PartNet-Mobility."""
    return folder.is_dir() and (folder / MAIN_FILE).is_file()


def read_partnet(folder: Path) -> RawAsset:
    """Returns what a PartNet-Mobility folder describes.

    Collision elements carry no names there; the meshes of visual elements that are called handles are, by their file
    names, the handles of the physics as well.

    Raises:
        ImportRefused: As for `read_urdf`.
        MissingExtra: As for `read_urdf`.
    """
    file = folder / MAIN_FILE
    inside = AssetFolder.of(file)
    raw = read_urdf(file, _handle_meshes(parsed_markup(inside, file)))
    return RawAsset(raw.links, raw.joints, _category(inside), raw.notes)


def _handle_meshes(robot: Any) -> frozenset[str]:
    """Names of the mesh files of visual elements that are called handles; `robot` is the file's root element."""
    return frozenset(
        Path(mesh.get("filename", "")).name
        for visual in robot.iter("visual")
        if is_handle_name(visual.get("name"))
        for mesh in visual.iter("mesh")
    )


def _category(folder: AssetFolder) -> str:
    meta = folder.here / "meta.json"
    if not meta.is_file():
        return ""
    try:
        data = json.loads(folder.read_text(meta))
    except (ValueError, RecursionError) as error:
        raise ImportRefused(meta, f"is no JSON: {error}", "download the folder again") from error
    name = data.get("model_cat") if isinstance(data, dict) else None
    if not isinstance(name, str):
        return ""
    # TrashCan is a trash_can.
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|[^A-Za-z0-9]+", "_", name).strip("_").lower()
    return _CATEGORIES.get(name, words if CATEGORY.fullmatch(words) else "")
