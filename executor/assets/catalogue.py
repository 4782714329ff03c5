"""Which family builds which scene category."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from bddl import near_names
from executor.assets.apple import apple
from executor.assets.bowl import bowl
from executor.assets.cabinet import cabinet
from executor.assets.model import Asset
from executor.assets.parameters import AssetError
from executor.assets.refrigerator import refrigerator
from executor.assets.table import table
from executor.assets.water_glass import water_glass
from oag import SceneObject

__all__ = ["FAMILIES", "AssetError", "asset_for"]

FAMILIES: Mapping[str, Callable[[SceneObject], Asset]] = MappingProxyType(
    {
        "apple": apple,
        "bowl": bowl,
        "cabinet": cabinet,
        "counter": cabinet,
        "countertop": cabinet,
        "desk": table,
        "fridge": refrigerator,
        "glass": water_glass,
        "refrigerator": refrigerator,
        "table": table,
    }
)


def asset_for(obj: SceneObject) -> Asset:
    """Returns an object's geometry: links, joints, handles and regions at its final size.

    Args:
        obj: A scene object; the last known word of its category names the family (a `bottom_cabinet` is a
            cabinet), its extent and parameters shape it.

    Raises:
        AssetError: When no family builds the category, or the object's size or a parameter is not one it can
            build.
    """
    words = obj.category.lower().split(".", 1)[0].replace("-", "_").split("_")
    family = next((FAMILIES[word] for word in reversed(words) if word in FAMILIES), None)
    if family is None:
        near = near_names(obj.category, sorted(FAMILIES))
        hint = f"did you mean {' or '.join(near)}? " if near else ""
        raise AssetError(obj, "no family builds this category", f"{hint}known: {', '.join(sorted(FAMILIES))}")
    return family(obj)
