"""What the names in a layout stand for: models of the library, and the heights at which things are mounted.

The robot's arm is mounted 0.30 m above the floor and reaches 0.6 m. Worktops and shelves that something is taken from
therefore are at the lower end of what homes have; docs/scenes.md says how far the rule of reach is from refusing one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

Range = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of thing.

    Attributes:
        models: Models of the library that are one; a variation takes one of them.
        sizes_m: Ranges of lengths along its own axes, instead of the library's.
        category: Category in the scene, instead of the library's.
        parameters: Parameters that every one of the kind has.
        single: Models with one door or drawer alone, of which the ones are that somebody has left open.
        single_parameters: Parameters with which the models of `single` have one door or drawer.
        unit: Whether all of the kind in a room are of one height and depth, under one worktop.
    """

    models: tuple[str, ...]
    sizes_m: Mapping[str, Range] = field(default_factory=dict)
    category: str = ""
    parameters: Mapping[str, object] = field(default_factory=dict)
    single: tuple[str, ...] = ()
    single_parameters: Mapping[str, object] = field(default_factory=dict)
    unit: bool = False


_CABINETS = ("cabinet_two_doors", "cabinet_one_door", "cabinet_drawers_doors")

KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        "refrigerator": Kind(
            (
                "fridge_one_door",
                "upright_one_door",
                "fridge_top_freezer",
                "fridge_freezer_drawer",
                "fridge_side_by_side",
            ),
            single=("fridge_one_door", "upright_one_door"),
        ),
        "cabinet": Kind((*_CABINETS, "cabinet_drawers"), single=("cabinet_one_door",), unit=True),
        "drawers": Kind(("cabinet_drawers",), unit=True),
        "dresser": Kind(("cabinet_drawers",), {"y": (0.55, 0.60), "z": (0.72, 0.76)}, category="dresser"),
        "counter": Kind(("counter_plain",), {"y": (0.60, 0.95)}, unit=True),
        "microwave": Kind(
            ("microwave_side_hinge",), {"x": (0.42, 0.46), "y": (0.46, 0.52)}, single=("microwave_side_hinge",)
        ),
        "oven": Kind(("oven_bottom_hinge",), single=("oven_bottom_hinge",), unit=True),
        "dishwasher": Kind(("dishwasher_bottom_hinge",), single=("dishwasher_bottom_hinge",), unit=True),
        "table": Kind(("table_four_legs", "table_round"), {"z": (0.56, 0.70)}),
        "long_table": Kind(("table_four_legs",), {"x": (0.60, 0.70), "y": (1.00, 1.20), "z": (0.58, 0.70)}, "table"),
        "workbench": Kind(
            ("table_four_legs",), {"x": (0.58, 0.68), "y": (1.00, 1.25), "z": (0.66, 0.74)}, category="work_bench"
        ),
        "coffee_table": Kind(("coffee_table",), {"x": (0.45, 0.60), "y": (0.70, 1.00), "z": (0.42, 0.48)}),
        "desk": Kind(("desk_with_drawers", "desk_four_legs"), {"x": (0.60, 0.70), "y": (1.00, 1.30)}),
        "nightstand": Kind(
            ("nightstand",), single=("nightstand",), single_parameters={"below": "niche"}, sizes_m={"z": (0.52, 0.60)}
        ),
        "wardrobe": Kind(("wardrobe_two_doors",)),
        "shelf": Kind(("shelf_open",), {"z": (0.80, 1.50)}, parameters={"boards": 2}),
        "low_shelf": Kind(("shelf_open",), {"z": (0.62, 0.72)}, "shelf", {"boards": 1}),
        "bed": Kind(("bed_single",)),
        "sofa": Kind(("sofa_two_seats",)),
        "chair": Kind(("chair_wooden",)),
        "glass": Kind(("tumbler",)),
        "cup": Kind(("cup",)),
        "mug": Kind(("mug",)),
        "bottle": Kind(("bottle",)),
        "medicine": Kind(("medicine_bottle",)),
        "can": Kind(("can",)),
        "apple": Kind(("red_apple",)),
        "half_apple": Kind(("half_apple",)),
        "orange": Kind(("orange",)),
        "bowl": Kind(("porcelain_bowl",)),
        "plate": Kind(("plate",)),
        "box": Kind(("carton",)),
        "open_box": Kind(("open_box",), category="box"),
        "die": Kind(("die",)),
        "black_die": Kind(("die",), parameters={"color": "black"}),
        "book": Kind(("book_upright", "book_lying")),
        "teddy_bear": Kind(("teddy_bear",)),
    }
)

# What lies about. Nothing of it is higher than what is asked for, so that hands still get in.
CLUTTER: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "kitchen": ("can", "cup", "mug", "plate", "porcelain_bowl", "carton", "orange", "red_apple"),
        "bedroom": ("book_lying", "cup", "carton", "medicine_bottle", "die", "half_apple"),
        "study": ("book_lying", "book_upright", "mug", "carton", "die", "open_box"),
        "workshop": ("carton", "can", "open_box", "die", "medicine_bottle", "mug"),
        "livingroom": ("book_lying", "cup", "plate", "orange", "porcelain_bowl", "can"),
        "storeroom": ("carton", "can", "open_box", "medicine_bottle", "orange"),
        "playroom": ("die", "book_lying", "carton", "cup", "open_box"),
    }
)


def kind_named(name: str) -> Kind | None:
    """Returns a kind by its name, or None when there is none."""
    return KINDS.get(name)
