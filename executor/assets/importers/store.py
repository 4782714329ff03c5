"""Store of imported assets, one JSON file each, and the geometry of scene objects that name one."""

from __future__ import annotations

import os
import re
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from bddl import near_names
from bddl.files import write_atomically
from executor.assets.asset_geometry import scaled
from executor.assets.model import Asset
from executor.assets.parameters import AssetError
from executor.system.files import content_key
from oag import SceneObject
from oag.model.symbols import Kind

SCHEMA = "scene2demo-asset/1"
PREFIX = "imported/"
"""Prefix of imported models in scenes."""
ASSETS_VARIABLE = "SCENE2DEMO_ASSETS"
NAME = re.compile(r"^[a-z][a-z0-9_]{0,39}$")
_SAME_SHAPE = 0.01  # Sizes in scenes are rounded.
_EXTENT_DIGITS = 5  # So is the factor: an asset at its own size is not scaled at all.


@checked(frozen=True, config=ConfigDict(extra="forbid", allow_inf_nan=False))
class StoredAsset:
    """The content of an asset's file.

    Attributes:
        schema_: Name and version of this form.
        kind: Kind of its objects: "articulated", "support" or "item".
        source: Name of the imported file.
        content: Short hash of everything that shapes it.
        notes: Inferences and omissions.
    """

    schema_: str
    kind: str
    asset: Asset
    source: str
    content: str
    notes: tuple[str, ...] = ()


_ADAPTER: TypeAdapter[StoredAsset] = TypeAdapter(StoredAsset)


@dataclass(frozen=True, slots=True)
class Imported:
    """A stored asset."""

    name: str
    path: Path
    stored: StoredAsset

    def as_object(self, object_id: str) -> SceneObject:
        """Return a scene object of this asset that stands on the floor at the origin."""
        extent = self.stored.asset.extent_m
        return SceneObject(
            id=object_id,
            category=self.stored.asset.category,
            model=PREFIX + self.name,
            position=(0.0, 0.0, extent[2] / 2),
            orientation=(1.0, 0.0, 0.0, 0.0),
            bbox_extent=extent,
            parameters={"content": self.stored.content},
        )


def assets_dir() -> Path:
    """Return the folder of imported assets: SCENE2DEMO_ASSETS, else `scene2demo/assets` in the XDG data folder."""
    chosen = os.environ.get(ASSETS_VARIABLE)
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_DATA_HOME")
    return (Path(base) if base else Path.home() / ".local" / "share") / "scene2demo" / "assets"


def keep(name: str, asset: Asset, kind: Kind, source: str, notes: tuple[str, ...]) -> Imported:
    """Write an asset's file and return it; a file of that name is replaced."""
    content = content_key(repr(asset))
    stored = StoredAsset(SCHEMA, kind.value, asset, source, content, notes)
    path = assets_dir() / f"{name}.json"
    write_atomically(path, _ADAPTER.dump_json(stored))
    return Imported(name, path, stored)


def names() -> tuple[str, ...]:
    """Return the names of all imported assets, sorted."""
    folder = assets_dir()
    return tuple(sorted(path.stem for path in folder.glob("*.json"))) if folder.is_dir() else ()


def imported_asset(obj: SceneObject) -> Asset:
    """Return the geometry of a scene object whose model is an imported asset, at the object's size.

    Raises:
        AssetError: There is no such asset, its file is broken, its content differs from the scene's, or the object's
            size is not the asset's times one factor.
    """
    stored = stored_asset(obj)
    # What is fixed to the room is still of the kind of its category.
    kind = replace(obj, fixed=False).kind.value
    if stored.kind != kind:
        problem = f"{obj.model} is {stored.kind}, a {obj.category} is {kind}"
        raise AssetError(obj, problem, f"use {stored.asset.category}")
    factors = [ours / its for ours, its in zip(obj.extent_m, stored.asset.extent_m, strict=True)]
    if max(factors) > (1 + _SAME_SHAPE) * min(factors):
        size = " x ".join(f"{value:.3f}" for value in stored.asset.extent_m)
        raise AssetError(obj, "its size stretches the asset", f"the asset has {size} m; all sides change by one factor")
    factor = round(factors[2], _EXTENT_DIGITS)
    return stored.asset if factor == 1.0 else scaled(stored.asset, factor)


def stored_asset(obj: SceneObject) -> StoredAsset:
    name = obj.model.removeprefix(PREFIX)
    path = assets_dir() / f"{name}.json"
    if not NAME.fullmatch(name) or not path.is_file():
        near = near_names(name, names())
        hint = f"did you mean {' or '.join(PREFIX + n for n in near)}? " if near else ""
        raise AssetError(obj, f"no asset {obj.model!r} was imported", f"{hint}`scene2demo assets import` makes one")
    found = path.stat()
    try:
        stored = _read(path, found.st_mtime_ns, found.st_size)
    except (ValidationError, OSError) as error:
        raise AssetError(obj, f"the file of {obj.model} cannot be read", "import it again") from error
    wanted = obj.parameters.get("content", stored.content)
    if stored.schema_ != SCHEMA or wanted != stored.content:
        problem = f"{obj.model} is not the asset that the scene was made with ({stored.content}, not {wanted})"
        raise AssetError(obj, problem, "import the same files again, or remove `content` from its parameters")
    return stored


@lru_cache(maxsize=64)
def _read(path: Path, modified_ns: int, size: int) -> StoredAsset:
    """Read a file once; the two numbers identify its version."""
    return _ADAPTER.validate_json(path.read_bytes())


def as_json(imported: Imported) -> dict[str, Any]:
    """Return a description of an imported asset as plain data."""
    asset = imported.stored.asset
    return {
        "model": PREFIX + imported.name,
        "path": str(imported.path),
        "category": asset.category,
        "kind": imported.stored.kind,
        "extent_m": list(asset.extent_m),
        "joints": [{"name": j.name, "kind": j.kind, "range": j.limits[1]} for j in asset.joints],
        "handles": [asdict(handle) for handle in asset.handles],
        "regions": [asdict(region) for region in asset.regions],
        "graspable_width_m": asset.graspable_width_m,
        "notes": list(imported.stored.notes),
        "content": imported.stored.content,
    }
