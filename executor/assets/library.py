"""The model library: ranges of all models, and the geometry of a scene object.

Models come from their families in `executor.assets.families`; a file there may bring models of its own. A scene object
without a model is built by the family of its category. A model `imported/NAME` is an imported asset.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from importlib import import_module
from types import MappingProxyType
from typing import TypeVar

from bddl import near_names
from bddl.errors import Scene2DemoError
from executor.assets import families
from executor.assets.asset_geometry import scaled
from executor.assets.families import appliances, furniture, items
from executor.assets.families.casework import HANDLE_PARAMETERS, HINGE
from executor.assets.families.controls import SWITCHING
from executor.assets.families.generic import GENERIC
from executor.assets.importers.store import PREFIX, imported_asset
from executor.assets.model import Asset
from executor.assets.parameters import (
    SAME_AS_WIDTH,
    AssetError,
    Builder,
    ChoiceParameter,
    ModelEntry,
    NumericParameter,
    Range,
)
from executor.assets.resistance import GASKET_FORCE, HANDLE_FORCE, with_resistance
from executor.system.files import content_key, json_text
from oag import SceneObject
from oag.model.symbols import Kind, kind_of

_HANDLE = (*HANDLE_PARAMETERS, HANDLE_FORCE)
_COLD = "electric_refrigerator.n.01"
_FRIDGE_LENGTH, _FRIDGE_WIDTH, _FRIDGE_HEIGHT = (0.66, 0.74), (0.56, 0.68), (1.40, 1.70)
_FRIDGE = (appliances.SHELVES, appliances.HANDLE_HEIGHT, *_HANDLE, GASKET_FORCE)
_BASE_LENGTH, _BASE_HEIGHT, _NARROW, _WIDE = (0.56, 0.66), (0.72, 0.90), (0.42, 0.60), (0.80, 1.10)
_SHELVES = (furniture.SHELVES, *_HANDLE)
_DESK = (furniture.SIDE, furniture.DESK_DRAWERS, furniture.PEDESTAL_WIDTH, *_HANDLE)
_RACKS = (appliances.RACKS, *_HANDLE)
_TOP = (furniture.TOP_THICKNESS,)
_BEAR_LENGTH, _BEAR_HEIGHT = (Range(ratio, ratio, of_width=True) for ratio in (items.BEAR_LENGTH, items.BEAR_HEIGHT))
_Length = Range | tuple[float, float]


def _entry(
    model: str,
    category: str,
    synset: str,
    build: Builder,
    length: _Length,
    width: _Length,
    height: _Length,
    *parameters: NumericParameter | ChoiceParameter,
) -> ModelEntry:
    x, y, z = (size if isinstance(size, Range) else Range(*size) for size in (length, width, height))
    return ModelEntry(model, category, synset, build, x, y, z, parameters)


# fmt: off
_ENTRIES = (
    _entry("upright_one_door", "refrigerator", "refrigerator.n.01", appliances.refrigerator,
           (0.62, 0.72), (0.54, 0.66), (1.10, 1.45), HINGE, appliances.CLASSIC_HANDLE_HEIGHT,
           HANDLE_FORCE, GASKET_FORCE),
    _entry("tumbler", "water_glass", "water_glass.n.02", items.water_glass,
           SAME_AS_WIDTH, (0.060, 0.080), (0.09, 0.14)),
    _entry("red_apple", "apple", "apple.n.01", items.apple, SAME_AS_WIDTH, (0.065, 0.085), SAME_AS_WIDTH),
    _entry("porcelain_bowl", "bowl", "bowl.n.01", items.bowl, SAME_AS_WIDTH, (0.14, 0.20), (0.05, 0.07)),
    _entry("fridge_one_door", "refrigerator", _COLD, appliances.fridge_one_door,
           _FRIDGE_LENGTH, _FRIDGE_WIDTH, (1.15, 1.45), HINGE, *_FRIDGE),
    _entry("fridge_top_freezer", "refrigerator", _COLD, appliances.fridge_top_freezer,
           _FRIDGE_LENGTH, _FRIDGE_WIDTH, _FRIDGE_HEIGHT, HINGE, *_FRIDGE),
    _entry("fridge_freezer_drawer", "refrigerator", _COLD, appliances.fridge_freezer_drawer,
           _FRIDGE_LENGTH, _FRIDGE_WIDTH, _FRIDGE_HEIGHT, HINGE, *_FRIDGE),
    _entry("fridge_side_by_side", "refrigerator", _COLD, appliances.fridge_side_by_side,
           _FRIDGE_LENGTH, (0.80, 0.95), _FRIDGE_HEIGHT, *_FRIDGE),
    _entry("cabinet_one_door", "bottom_cabinet", "cabinet.n.01", furniture.cabinet_one_door,
           _BASE_LENGTH, _NARROW, _BASE_HEIGHT, HINGE, *_SHELVES),
    _entry("cabinet_two_doors", "bottom_cabinet", "cabinet.n.01", furniture.cabinet_two_doors,
           _BASE_LENGTH, _WIDE, _BASE_HEIGHT, *_SHELVES),
    _entry("cabinet_drawers", "bottom_cabinet", "cabinet.n.01", furniture.cabinet_drawers,
           _BASE_LENGTH, _NARROW, _BASE_HEIGHT, furniture.DRAWERS, *_HANDLE),
    _entry("cabinet_drawers_doors", "bottom_cabinet", "cabinet.n.01", furniture.cabinet_drawers_doors,
           _BASE_LENGTH, _WIDE, _BASE_HEIGHT, *_SHELVES),
    _entry("nightstand", "nightstand", "stand.n.04", furniture.nightstand,
           (0.40, 0.50), (0.40, 0.55), (0.50, 0.62), furniture.BELOW, *_HANDLE),
    _entry("wardrobe_two_doors", "wardrobe", "wardrobe.n.01", furniture.wardrobe,
           (0.58, 0.68), (0.85, 1.10), (1.50, 1.90), furniture.WARDROBE_SHELVES, *_HANDLE),
    _entry("desk_with_drawers", "desk_with_drawers", "desk.n.01", furniture.desk_with_drawers,
           (0.60, 0.75), (1.00, 1.40), (0.68, 0.76), *_DESK),
    _entry("microwave_side_hinge", "microwave", "microwave.n.02", appliances.microwave,
           (0.42, 0.50), (0.46, 0.56), (0.27, 0.33), *SWITCHING, *_HANDLE),
    _entry("oven_bottom_hinge", "oven", "oven.n.01", appliances.oven,
           (0.60, 0.70), (0.54, 0.62), (0.80, 0.90), *SWITCHING, *_RACKS),
    _entry("dishwasher_bottom_hinge", "dishwasher", "dishwasher.n.01", appliances.dishwasher,
           (0.60, 0.70), (0.45, 0.62), (0.80, 0.90), *_RACKS),
    _entry("table_four_legs", "table", "table.n.02", furniture.table, (0.60, 1.20), (0.50, 0.80), (0.55, 0.75), *_TOP),
    _entry("coffee_table", "coffee_table", "coffee_table.n.01", furniture.table,
           (0.60, 1.00), (0.45, 0.60), (0.38, 0.48), *_TOP),
    _entry("desk_four_legs", "desk", "desk.n.01", furniture.table, (1.00, 1.40), (0.55, 0.70), (0.68, 0.76), *_TOP),
    _entry("table_round", "table", "pedestal_table.n.01", furniture.round_table,
           SAME_AS_WIDTH, (0.60, 0.90), (0.55, 0.75), *_TOP),
    _entry("counter_plain", "countertop", "countertop.n.01", furniture.counter,
           (0.55, 0.65), (0.60, 1.40), (0.70, 0.90), *_TOP),
    _entry("shelf_open", "shelf", "shelf.n.01", furniture.shelf,
           (0.26, 0.36), (0.60, 1.00), (0.60, 1.60), furniture.BOARDS),
    _entry("bed_single", "bed", "bed.n.01", furniture.bed, (1.90, 2.05), (0.90, 1.30), (0.80, 1.00)),
    _entry("sofa_two_seats", "sofa", "sofa.n.01", furniture.sofa, (0.80, 0.92), (1.35, 1.75), (0.74, 0.86)),
    _entry("chair_wooden", "chair", "chair.n.01", furniture.chair, (0.40, 0.46), (0.40, 0.45), (0.80, 0.92)),
    _entry("cup", "cup", "cup.n.01", items.cup, SAME_AS_WIDTH, (0.060, 0.080), (0.070, 0.100), items.CUP_COLOR),
    _entry("mug", "mug", "mug.n.04", items.mug,
           Range(1.35, 1.50, of_width=True), (0.070, 0.085), (0.080, 0.100), items.CUP_COLOR),
    _entry("bottle", "bottle", "bottle.n.01", items.bottle,
           SAME_AS_WIDTH, (0.055, 0.075), (0.18, 0.26), items.NECK, items.SHOULDER),
    _entry("medicine_bottle", "medicine_bottle", "pill_bottle.n.01", items.medicine_bottle,
           SAME_AS_WIDTH, (0.034, 0.055), (0.06, 0.10)),
    _entry("can", "can", "can.n.01", items.can,
           SAME_AS_WIDTH, (0.052, 0.066), (0.090, 0.125), items.CAN_COLOR),
    _entry("orange", "orange", "orange.n.01", items.orange, SAME_AS_WIDTH, (0.060, 0.085), SAME_AS_WIDTH),
    _entry("half_apple", "half_apple", "half__apple.n.01", items.half_apple,
           SAME_AS_WIDTH, (0.055, 0.085), Range(0.45, 0.52, of_width=True)),
    _entry("plate", "plate", "plate.n.04", items.plate, SAME_AS_WIDTH, (0.17, 0.25), (0.016, 0.024)),
    _entry("carton", "box", "box.n.01", items.carton,
           (0.060, 0.120), (0.040, 0.060), (0.060, 0.160), items.BOX_COLOR),
    _entry("open_box", "box", "box.n.01", items.open_box,
           (0.140, 0.240), (0.120, 0.180), (0.060, 0.100), items.BOX_COLOR, items.BOX_WALL),
    _entry("die", "die", "die.n.01", items.die, SAME_AS_WIDTH, (0.030, 0.055), SAME_AS_WIDTH, items.DIE_COLOR),
    _entry("book_upright", "book", "hardback.n.01", items.book,
           (0.10, 0.13), (0.024, 0.042), (0.15, 0.19), items.BOOK_COLOR),
    _entry("book_lying", "book", "hardback.n.01", items.book,
           (0.18, 0.24), (0.12, 0.16), (0.020, 0.045), items.BOOK_COLOR),
    _entry("teddy_bear", "teddy_bear", "teddy.n.01", items.teddy_bear,
           _BEAR_LENGTH, (0.090, 0.150), _BEAR_HEIGHT, items.FUR),
)
# fmt: on
_FAMILIES: Mapping[str, Builder] = {
    "apple": items.apple,
    "bear": items.teddy_bear,
    "book": items.book,
    "bottle": items.bottle,
    "bowl": items.bowl,
    "box": items.carton,
    "cabinet": furniture.cabinet,
    "can": items.can,
    "counter": furniture.cabinet,
    "countertop": furniture.cabinet,
    "cup": items.cup,
    "desk": furniture.table,
    "die": items.die,
    "dishwasher": appliances.dishwasher,
    "floor": furniture.floor,
    "fridge": appliances.refrigerator,
    "glass": items.water_glass,
    "microwave": appliances.microwave,
    "mug": items.mug,
    "nightstand": furniture.nightstand,
    "orange": items.orange,
    "oven": appliances.oven,
    "plate": items.plate,
    "refrigerator": appliances.refrigerator,
    "shelf": furniture.shelf,
    "table": furniture.table,
    "wall": furniture.wall,
    "wardrobe": furniture.wardrobe,
}


class NameTaken(Scene2DemoError, ValueError):
    """Two files of the library give one name."""

    def __init__(self, kind: str, name: str, first: str, second: str) -> None:
        advice = "expected a name of its own: rename or remove it"
        super().__init__(f"{second}: the {kind} {name!r} is given by {first} already; {advice}")


_Given = TypeVar("_Given")


def _with_added(kind: str, own: Mapping[str, _Given], added: Iterable[tuple[str, str, _Given]]) -> Mapping[str, _Given]:
    """Return what this file and the files of `families` give by name."""
    given, givers = dict(own), dict.fromkeys(own, __file__)
    for file, name, one in added:
        if name in given:
            raise NameTaken(kind, name, givers[name], file)
        given[name], givers[name] = one, file
    return MappingProxyType(given)


# A module of `families` may declare models of its own (`MODELS`), and builders of categories (`FAMILIES`).
_MODULES = [import_module(f"{families.__name__}.{found.name}") for found in pkgutil.iter_modules(families.__path__)]
LIBRARY = _with_added(
    "model",
    {entry.model: entry for entry in _ENTRIES},
    ((str(module.__file__), entry.model, entry) for module in _MODULES for entry in getattr(module, "MODELS", ())),
)
"""Every model by its name."""
BUILT: Mapping[str, ModelEntry] = MappingProxyType({**LIBRARY, **GENERIC})
"""The library's models and the generic shapes, which objects of any category can have."""
FAMILIES = _with_added(
    "category's word",
    _FAMILIES,
    (
        (str(module.__file__), word, build)
        for module in _MODULES
        for word, build in getattr(module, "FAMILIES", {}).items()
    ),
)
"""Last known word of a category -> builder of its objects without a model."""
# All their lengths scale with the extent, so that building them at their final size differs by rounding only.
_EXACT = (items.apple, items.water_glass)


class ModelNotFound(LookupError):
    """The library has no model of this name."""

    def __init__(self, name: str) -> None:
        near = near_names(name, tuple(LIBRARY))
        hint = f"did you mean {' or '.join(near)}? " if near else ""
        super().__init__(f"the library has no model {name!r}; {hint}`scene2demo assets` lists them")


def entry(model: str) -> ModelEntry:
    """Return the library's entry of a model."""
    if model not in LIBRARY:
        raise ModelNotFound(model)
    return LIBRARY[model]


def sample(model: str, seed: int, object_id: str | None = None) -> SceneObject:
    """Draw a variation of a model that stands on the floor at the origin; equal seeds give equal variations."""
    return entry(model).sample(seed, object_id)


def kind(item: ModelEntry) -> Kind:
    """Return the kind of a model's objects: articulated fixture, support or item."""
    return kind_of(item.category, item.width.low)


def asset_for(obj: SceneObject) -> Asset:
    """Return an object's geometry: links, joints, handles and regions at its final size.

    Args:
        obj: A scene object. Its `model` names an entry of the library, a generic shape, or an imported asset
            (`imported/NAME`). For any other model, the last known word of its category names the family (a
            `bottom_cabinet` is a cabinet). Its extent and parameters shape it.

    Raises:
        AssetError: No family builds the category, or the family cannot build the object's size or a parameter.
    """
    if obj.model.startswith(PREFIX):
        asset = imported_asset(obj)
    else:
        known = BUILT.get(obj.model)
        asset = _at_size(obj, _family(obj) if known is None else known.build)
        asset = asset if known is None else replace(asset, synset=known.synset)
    asset = with_resistance(obj, asset)
    return _fixed(asset) if obj.fixed else asset


def _fixed(asset: Asset) -> Asset:
    """Return an asset that is not free to move, and neither is taken nor carries anything; its joints still resist."""
    motion = "static" if asset.motion == "dynamic" else asset.motion
    return replace(asset, motion=motion, handles=(), regions=(), graspable_width_m=None, rim=None)


def asset_hash(obj: SceneObject) -> str:
    """Return a hash of all that an object is built of: shapes, masses, friction, joints, handles and regions.

    Raises:
        AssetError: As for `asset_for`.
    """
    return content_key(json_text(asdict(asset_for(obj))))


def _at_size(obj: SceneObject, family: Builder) -> Asset:
    if obj.kind is not Kind.ITEM or len(set(obj.scale)) > 1 or family in _EXACT:
        return family(obj)
    # A smaller mug has thinner walls: build it at its original size, then scale all of it.
    return scaled(family(replace(obj, scale=(1.0, 1.0, 1.0))), obj.scale[0])


def _family(obj: SceneObject) -> Builder:
    words = obj.category.lower().split(".", 1)[0].replace("-", "_").split("_")
    family = next((FAMILIES[word] for word in reversed(words) if word in FAMILIES), None)
    if family is None:
        near = near_names(obj.category, sorted(FAMILIES))
        hint = f"did you mean {' or '.join(near)}? " if near else ""
        raise AssetError(obj, "no family builds this category", f"{hint}known: {', '.join(sorted(FAMILIES))}")
    return family
