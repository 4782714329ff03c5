"""Kitchen pieces beside base cabinets: wall cabinet, French-door refrigerator, sink."""

from __future__ import annotations

from executor.assets.families.appliances import HANDLE_HEIGHT, SHELVES, cold_appliance
from executor.assets.families.casework import HANDLE_PARAMETERS, Case, Column, Compartment, Grip, assemble
from executor.assets.families.furniture import SHELVES as BOARDS
from executor.assets.families.shapes import UP, box, fixture
from executor.assets.model import Asset, Region
from executor.assets.parameters import ModelEntry, NumericParameter, Range, require_size
from executor.assets.resistance import GASKET_FORCE, HANDLE_FORCE
from oag import SceneObject

_WHITE, _STEEL, _GLASS = (0.78, 0.80, 0.81), (0.60, 0.62, 0.64), (0.86, 0.88, 0.90)
_CABINET, _STONE = (0.62, 0.63, 0.60), (0.36, 0.36, 0.38)
_RIM_M, _PANEL_M = 0.06, 0.012  # Of the top beside the basin; of the basin's walls.
BASIN_DEPTH = NumericParameter("basin_depth_m", 0.18, 0.12, 0.22)


def wall_cabinet(obj: SceneObject) -> Asset:
    """Return a cabinet that hangs on a wall: a pair of doors, hinged at the outer sides."""
    extent = require_size(obj, (0.25, 0.50, 0.35))
    count = BOARDS.count(obj)
    left, right = Compartment("left_door", "left", shelves=count), Compartment("right_door", "right", shelves=count)
    case = Case(extent, (Column((left,)), Column((right,))), Grip.of(obj), base_m=0.0)
    return assemble(case, obj.category, "cabinet.n.01", extra=())


def fridge_french_door(obj: SceneObject) -> Asset:
    """Return a refrigerator with a pair of doors over two freezer drawers."""
    count = SHELVES.count(obj)
    columns = tuple(
        Column((Compartment(f"{side}_drawer", "drawer", 0.32), Compartment(f"{side}_door", side, 0.68, count)))
        for side in ("left", "right")
    )
    return cold_appliance(obj, *columns)


def sink(obj: SceneObject) -> Asset:
    """Return a sink: a basin in the top of a solid unit."""
    x, y, z = (length / 2 for length in require_size(obj, (0.40, 0.40, 0.50)))
    inner_x, inner_y, floor = x - _RIM_M, y - _RIM_M, z - BASIN_DEPTH.read(obj)
    wall_x, wall_y = inner_x + _PANEL_M, inner_y + _PANEL_M
    shapes = (
        box((-x, -y, -z), (x, y, floor - _PANEL_M), _CABINET),
        box((-wall_x, -wall_y, floor - _PANEL_M), (wall_x, wall_y, floor), _STEEL),
        box((-x, -y, floor - _PANEL_M), (-inner_x, y, z), _STONE),
        box((inner_x, -y, floor - _PANEL_M), (x, y, z), _STONE),
        box((-inner_x, -y, floor - _PANEL_M), (inner_x, -inner_y, z), _STONE),
        box((-inner_x, inner_y, floor - _PANEL_M), (inner_x, y, z), _STONE),
    )
    basin = Region("basin", "interior", "sink", (0.0, 0.0, (floor + z) / 2), (inner_x, inner_y, (z - floor) / 2), UP)
    return fixture(obj, "sink", shapes, obj.extent_m, "sink.n.01", basin)


_HANDLE = (*HANDLE_PARAMETERS, HANDLE_FORCE)
MODELS = (
    ModelEntry(
        "wall_cabinet_two_doors",
        "wall_cabinet",
        "cabinet.n.01",
        wall_cabinet,
        Range(0.32, 0.42),
        Range(0.60, 1.00),
        Range(0.50, 0.90),
        (BOARDS, *_HANDLE),
    ),
    ModelEntry(
        "fridge_french_door",
        "refrigerator",
        "electric_refrigerator.n.01",
        fridge_french_door,
        Range(0.66, 0.85),
        Range(0.80, 0.95),
        Range(1.60, 1.85),
        (SHELVES, HANDLE_HEIGHT, *_HANDLE, GASKET_FORCE),
    ),
    ModelEntry(
        "sink_unit", "sink", "sink.n.01", sink, Range(0.50, 0.65), Range(0.50, 0.90), Range(0.80, 0.92), (BASIN_DEPTH,)
    ),
)
FAMILIES = {"sink": sink}
