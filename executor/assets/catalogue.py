"""Which family builds which scene object: that of the library's model which it names, else its category's."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

from bddl import near_names
from executor.assets.apple import apple
from executor.assets.appliances import dishwasher, microwave, oven
from executor.assets.bedroom import nightstand, wardrobe
from executor.assets.book import book
from executor.assets.bottle import bottle
from executor.assets.bowl import bowl
from executor.assets.cabinet import cabinet
from executor.assets.can import can
from executor.assets.carton import carton
from executor.assets.cup import cup, mug
from executor.assets.die import die
from executor.assets.fruit import orange
from executor.assets.imports.stored import PREFIX, imported_asset
from executor.assets.library import LIBRARY
from executor.assets.model import Asset
from executor.assets.parameters import AssetError
from executor.assets.placing import scaled
from executor.assets.plate import plate
from executor.assets.refrigerator import refrigerator
from executor.assets.supports import shelf
from executor.assets.table import table
from executor.assets.teddy_bear import teddy_bear
from executor.assets.wall import wall
from executor.assets.water_glass import water_glass
from oag import Kind, SceneObject

__all__ = ["FAMILIES", "AssetError", "asset_for"]

FAMILIES: Mapping[str, Callable[[SceneObject], Asset]] = MappingProxyType(
    {
        "apple": apple,
        "bear": teddy_bear,
        "book": book,
        "bottle": bottle,
        "bowl": bowl,
        "box": carton,
        "cabinet": cabinet,
        "can": can,
        "counter": cabinet,
        "countertop": cabinet,
        "cup": cup,
        "desk": table,
        "die": die,
        "dishwasher": dishwasher,
        "fridge": refrigerator,
        "glass": water_glass,
        "microwave": microwave,
        "mug": mug,
        "nightstand": nightstand,
        "orange": orange,
        "oven": oven,
        "plate": plate,
        "refrigerator": refrigerator,
        "shelf": shelf,
        "table": table,
        "wall": wall,
        "wardrobe": wardrobe,
    }
)
# Their every length follows the extent, so that building them at their final size is the same but for rounding.
_EXACT = (apple, water_glass)


def asset_for(obj: SceneObject) -> Asset:
    """Returns an object's geometry: links, joints, handles and regions at its final size.

    Args:
        obj: A scene object. Its `model` names an entry of the library, or an imported asset (`imported/NAME`); where
            there is none of that name, the last known word of its category names the family (a `bottom_cabinet` is
            a cabinet). Its extent and parameters shape it.

    Raises:
        AssetError: When no family builds the category, or the object's size or a parameter is not one it can
            build.
    """
    if obj.model.startswith(PREFIX):
        return imported_asset(obj)
    asset = _at_size(obj, _family(obj))
    synset = LIBRARY[obj.model].synset if obj.model in LIBRARY else asset.synset
    return asset if asset.synset == synset else replace(asset, synset=synset)


def _at_size(obj: SceneObject, family: Callable[[SceneObject], Asset]) -> Asset:
    if obj.kind is not Kind.ITEM or len(set(obj.scale)) > 1 or family in _EXACT:
        return family(obj)
    # A smaller mug has thinner walls: it is built at its own size, and then everything shrinks alike.
    return scaled(family(replace(obj, scale=(1.0, 1.0, 1.0))), obj.scale[0])


def _family(obj: SceneObject) -> Callable[[SceneObject], Asset]:
    if obj.model in LIBRARY:
        return LIBRARY[obj.model].build
    words = obj.category.lower().split(".", 1)[0].replace("-", "_").split("_")
    family = next((FAMILIES[word] for word in reversed(words) if word in FAMILIES), None)
    if family is None:
        near = near_names(obj.category, sorted(FAMILIES))
        hint = f"did you mean {' or '.join(near)}? " if near else ""
        raise AssetError(obj, "no family builds this category", f"{hint}known: {', '.join(sorted(FAMILIES))}")
    return family
