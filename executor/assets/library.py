"""Every model that a scene object can name, with the ranges that it varies in, and how an object gets its geometry.

The models come from their families in `executor.assets.models`; a scene object that names none is built by the family
of its category, and one that names an imported asset is that asset.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from bddl import near_names
from executor.assets.imports.stored import PREFIX, imported_asset
from executor.assets.model import Asset
from executor.assets.models import appliances, cabinets, cold_storage, containers, food, furniture, tableware, toys
from executor.assets.parameters import SAME_AS_WIDTH, AssetError, Builder, ModelEntry, Option, Quantity, Range
from executor.assets.parts.layout import HANDLE_PARAMETERS, HINGE
from executor.assets.resistance import GASKET_FORCE, HANDLE_FORCE, with_resistance
from executor.assets.transforms import scaled
from oag import Kind, SceneObject, kind_of

_HANDLE = (*HANDLE_PARAMETERS, HANDLE_FORCE)
_COLD = "electric_refrigerator.n.01"
_FRIDGE_LENGTH, _FRIDGE_WIDTH, _FRIDGE_HEIGHT = (0.66, 0.74), (0.56, 0.68), (1.40, 1.70)
_FRIDGE = (cold_storage.SHELVES, cold_storage.HANDLE_HEIGHT, *_HANDLE, GASKET_FORCE)
_BASE_LENGTH, _BASE_HEIGHT, _NARROW, _WIDE = (0.56, 0.66), (0.72, 0.90), (0.42, 0.60), (0.80, 1.10)
_SHELVES = (cabinets.SHELVES, *_HANDLE)
_DESK = (cabinets.SIDE, cabinets.DESK_DRAWERS, cabinets.PEDESTAL_WIDTH, *_HANDLE)
_RACKS = (appliances.RACKS, *_HANDLE)
_TOP = (furniture.TOP_THICKNESS,)
_BEAR_LENGTH, _BEAR_HEIGHT = (Range(ratio, ratio, of_width=True) for ratio in (toys.BEAR_LENGTH, toys.BEAR_HEIGHT))
_Length = Range | tuple[float, float]


def _entry(
    model: str,
    category: str,
    synset: str,
    build: Builder,
    length: _Length,
    width: _Length,
    height: _Length,
    *parameters: Quantity | Option,
) -> ModelEntry:
    x, y, z = (size if isinstance(size, Range) else Range(*size) for size in (length, width, height))
    return ModelEntry(model, category, synset, build, x, y, z, parameters)


# fmt: off
_ENTRIES = (
    _entry("upright_one_door", "refrigerator", "refrigerator.n.01", cold_storage.refrigerator,
           (0.62, 0.72), (0.54, 0.66), (1.10, 1.45), HINGE, cold_storage.CLASSIC_HANDLE_HEIGHT,
           HANDLE_FORCE, GASKET_FORCE),
    _entry("tumbler", "water_glass", "water_glass.n.02", tableware.water_glass,
           SAME_AS_WIDTH, (0.060, 0.080), (0.09, 0.14)),
    _entry("red_apple", "apple", "apple.n.01", food.apple, SAME_AS_WIDTH, (0.065, 0.085), SAME_AS_WIDTH),
    _entry("porcelain_bowl", "bowl", "bowl.n.01", tableware.bowl, SAME_AS_WIDTH, (0.14, 0.20), (0.05, 0.07)),
    _entry("fridge_one_door", "refrigerator", _COLD, cold_storage.fridge_one_door,
           _FRIDGE_LENGTH, _FRIDGE_WIDTH, (1.15, 1.45), HINGE, *_FRIDGE),
    _entry("fridge_top_freezer", "refrigerator", _COLD, cold_storage.fridge_top_freezer,
           _FRIDGE_LENGTH, _FRIDGE_WIDTH, _FRIDGE_HEIGHT, HINGE, *_FRIDGE),
    _entry("fridge_freezer_drawer", "refrigerator", _COLD, cold_storage.fridge_freezer_drawer,
           _FRIDGE_LENGTH, _FRIDGE_WIDTH, _FRIDGE_HEIGHT, HINGE, *_FRIDGE),
    _entry("fridge_side_by_side", "refrigerator", _COLD, cold_storage.fridge_side_by_side,
           _FRIDGE_LENGTH, (0.80, 0.95), _FRIDGE_HEIGHT, *_FRIDGE),
    _entry("cabinet_one_door", "bottom_cabinet", "cabinet.n.01", cabinets.cabinet_one_door,
           _BASE_LENGTH, _NARROW, _BASE_HEIGHT, HINGE, *_SHELVES),
    _entry("cabinet_two_doors", "bottom_cabinet", "cabinet.n.01", cabinets.cabinet_two_doors,
           _BASE_LENGTH, _WIDE, _BASE_HEIGHT, *_SHELVES),
    _entry("cabinet_drawers", "bottom_cabinet", "cabinet.n.01", cabinets.cabinet_drawers,
           _BASE_LENGTH, _NARROW, _BASE_HEIGHT, cabinets.DRAWERS, *_HANDLE),
    _entry("cabinet_drawers_doors", "bottom_cabinet", "cabinet.n.01", cabinets.cabinet_drawers_doors,
           _BASE_LENGTH, _WIDE, _BASE_HEIGHT, *_SHELVES),
    _entry("nightstand", "nightstand", "stand.n.04", cabinets.nightstand,
           (0.40, 0.50), (0.40, 0.55), (0.50, 0.62), cabinets.BELOW, *_HANDLE),
    _entry("wardrobe_two_doors", "wardrobe", "wardrobe.n.01", cabinets.wardrobe,
           (0.58, 0.68), (0.85, 1.10), (1.50, 1.90), cabinets.WARDROBE_SHELVES, *_HANDLE),
    _entry("desk_with_drawers", "desk_with_drawers", "desk.n.01", cabinets.desk_with_drawers,
           (0.60, 0.75), (1.00, 1.40), (0.68, 0.76), *_DESK),
    _entry("microwave_side_hinge", "microwave", "microwave.n.02", appliances.microwave,
           (0.42, 0.50), (0.46, 0.56), (0.27, 0.33), *_HANDLE),
    _entry("oven_bottom_hinge", "oven", "oven.n.01", appliances.oven,
           (0.60, 0.70), (0.54, 0.62), (0.80, 0.90), *_RACKS),
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
    _entry("cup", "cup", "cup.n.01", tableware.cup, SAME_AS_WIDTH, (0.060, 0.080), (0.070, 0.100), tableware.CUP_COLOR),
    _entry("mug", "mug", "mug.n.04", tableware.mug,
           Range(1.35, 1.50, of_width=True), (0.070, 0.085), (0.080, 0.100), tableware.CUP_COLOR),
    _entry("bottle", "bottle", "bottle.n.01", containers.bottle,
           SAME_AS_WIDTH, (0.055, 0.075), (0.18, 0.26), containers.NECK, containers.SHOULDER),
    _entry("medicine_bottle", "medicine_bottle", "pill_bottle.n.01", containers.medicine_bottle,
           SAME_AS_WIDTH, (0.034, 0.055), (0.06, 0.10)),
    _entry("can", "can", "can.n.01", containers.can,
           SAME_AS_WIDTH, (0.052, 0.066), (0.090, 0.125), containers.CAN_COLOR),
    _entry("orange", "orange", "orange.n.01", food.orange, SAME_AS_WIDTH, (0.060, 0.085), SAME_AS_WIDTH),
    _entry("half_apple", "half_apple", "half__apple.n.01", food.half_apple,
           SAME_AS_WIDTH, (0.055, 0.085), Range(0.45, 0.52, of_width=True)),
    _entry("plate", "plate", "plate.n.04", tableware.plate, SAME_AS_WIDTH, (0.17, 0.25), (0.016, 0.024)),
    _entry("carton", "box", "box.n.01", containers.carton,
           (0.060, 0.120), (0.040, 0.060), (0.060, 0.160), containers.BOX_COLOR),
    _entry("open_box", "box", "box.n.01", containers.open_box,
           (0.140, 0.240), (0.120, 0.180), (0.060, 0.100), containers.BOX_COLOR, containers.BOX_WALL),
    _entry("die", "die", "die.n.01", toys.die, SAME_AS_WIDTH, (0.030, 0.055), SAME_AS_WIDTH, toys.DIE_COLOR),
    _entry("book_upright", "book", "hardback.n.01", toys.book,
           (0.10, 0.13), (0.024, 0.042), (0.15, 0.19), toys.BOOK_COLOR),
    _entry("book_lying", "book", "hardback.n.01", toys.book,
           (0.18, 0.24), (0.12, 0.16), (0.020, 0.045), toys.BOOK_COLOR),
    _entry("teddy_bear", "teddy_bear", "teddy.n.01", toys.teddy_bear,
           _BEAR_LENGTH, (0.090, 0.150), _BEAR_HEIGHT, toys.FUR),
)
# fmt: on
LIBRARY: Mapping[str, ModelEntry] = MappingProxyType({entry.model: entry for entry in _ENTRIES})
"""Every model by its name."""
FAMILIES: Mapping[str, Builder] = MappingProxyType(
    {
        "apple": food.apple,
        "bear": toys.teddy_bear,
        "book": toys.book,
        "bottle": containers.bottle,
        "bowl": tableware.bowl,
        "box": containers.carton,
        "cabinet": cabinets.cabinet,
        "can": containers.can,
        "counter": cabinets.cabinet,
        "countertop": cabinets.cabinet,
        "cup": tableware.cup,
        "desk": furniture.table,
        "die": toys.die,
        "dishwasher": appliances.dishwasher,
        "floor": furniture.floor,
        "fridge": cold_storage.refrigerator,
        "glass": tableware.water_glass,
        "microwave": appliances.microwave,
        "mug": tableware.mug,
        "nightstand": cabinets.nightstand,
        "orange": food.orange,
        "oven": appliances.oven,
        "plate": tableware.plate,
        "refrigerator": cold_storage.refrigerator,
        "shelf": furniture.shelf,
        "table": furniture.table,
        "wall": furniture.wall,
        "wardrobe": cabinets.wardrobe,
    }
)
"""The last known word of a category, and what builds an object of it that names no model."""
# Their every length follows the extent, so that building them at their final size is the same but for rounding.
_EXACT = (food.apple, tableware.water_glass)


class ModelNotFound(LookupError):
    """The library has no model of this name."""

    def __init__(self, name: str) -> None:
        near = near_names(name, tuple(LIBRARY))
        hint = f"did you mean {' or '.join(near)}? " if near else ""
        super().__init__(f"the library has no model {name!r}; {hint}`scene2demo assets` lists them")


def entry(model: str) -> ModelEntry:
    """Returns the library's entry of a model.

    Raises:
        ModelNotFound: When there is none of that name; the message has near ones.
    """
    if model not in LIBRARY:
        raise ModelNotFound(model)
    return LIBRARY[model]


def sample(model: str, seed: int, object_id: str | None = None) -> SceneObject:
    """Returns a variation of a model that stands on the floor at the origin; equal seeds give equal ones.

    Raises:
        ModelNotFound: When the library has no such model.
    """
    return entry(model).sample(seed, object_id)


def kind(item: ModelEntry) -> Kind:
    """Returns how the robot deals with things of a model: articulated fixture, support or item."""
    return kind_of(item.category, item.width.low)


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
        return with_resistance(obj, imported_asset(obj))
    asset = _at_size(obj, LIBRARY[obj.model].build if obj.model in LIBRARY else _family(obj))
    asset = replace(asset, synset=LIBRARY[obj.model].synset) if obj.model in LIBRARY else asset
    return with_resistance(obj, asset)


def _at_size(obj: SceneObject, family: Builder) -> Asset:
    if obj.kind is not Kind.ITEM or len(set(obj.scale)) > 1 or family in _EXACT:
        return family(obj)
    # A smaller mug has thinner walls: it is built at its own size, and then everything shrinks alike.
    return scaled(family(replace(obj, scale=(1.0, 1.0, 1.0))), obj.scale[0])


def _family(obj: SceneObject) -> Builder:
    words = obj.category.lower().split(".", 1)[0].replace("-", "_").split("_")
    family = next((FAMILIES[word] for word in reversed(words) if word in FAMILIES), None)
    if family is None:
        near = near_names(obj.category, sorted(FAMILIES))
        hint = f"did you mean {' or '.join(near)}? " if near else ""
        raise AssetError(obj, "no family builds this category", f"{hint}known: {', '.join(sorted(FAMILIES))}")
    return family
