"""Parts and spots that subtasks name: which handles, which regions, and whether a detector agrees."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import bddl
import llm
from executor.assets.model import Region
from executor.geometry import transform
from executor.planning.whereabouts import (
    ends_at_side,
    handles_of,
    parts_named,
    read_where,
    regions_next_to,
    regions_of,
)
from executor.rollouts.capacity import first_misfit, no_part
from executor.rollouts.feasibility import feasible
from executor.rollouts.rollout import rollout
from executor.scenes.file import complete_scene
from executor.sim.world import World
from oag import Scene, SimpleTask, Task, compose
from oag.model.symbols import GRIPPER
from oag.model.where import Where


def _scene(yaw_deg: float = 0.0) -> Scene:
    found = complete_scene(
        {
            "robot": {"position": [0, 0], "heading_deg": yaw_deg},
            "objects": {
                "table_0": {"category": "table", "position": [1.3, 0.0], "bbox_extent": [0.8, 1.2, 0.7]},
                "can_0": {"category": "can", "on": "table_0", "at": [0.0, -0.25]},
                "mug_0": {"category": "mug", "on": "table_0", "at": [0.0, 0.0]},
                "cabinet_0": {"category": "bottom_cabinet", "model": "cabinet_drawers", "position": [0.2, 1.9]},
                "wardrobe_0": {"category": "wardrobe", "position": [0.2, -2.2], "heading_deg": 90.0},
                "shelf_0": {"category": "shelf", "position": [2.9, 1.9]},
            },
        }
    ).scene
    assert found is not None
    return found


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    with World(_scene(), oracle=True) as made:
        yield made


@pytest.mark.parametrize(
    ("which", "place"), [("top", 0), ("first", 0), ("second", 1), ("third", 2), ("bottom", 2), ("last", 2)]
)
def test_drawers_are_counted_from_the_top(world: World, which: str, place: int) -> None:
    asset = world.assets["cabinet_0"]
    heights = sorted({asset.joint(bar.joint).position_m[2] + bar.position_m[2] for bar in asset.handles}, reverse=True)
    (bar,) = handles_of(world, "cabinet_0", Where("", "", which, "drawer"))
    assert asset.joint(bar.joint).position_m[2] + bar.position_m[2] == heights[place]
    regions = regions_of(world, "cabinet_0", asset.regions, Where("", "", which, "drawer"))
    assert {region.joint for region in regions} == {bar.joint}


@pytest.mark.parametrize(("which", "sign"), [("left", 1.0), ("right", -1.0)])
def test_doors_are_left_and_right_as_one_stands_before_them(world: World, which: str, sign: float) -> None:
    (bar,) = handles_of(world, "wardrobe_0", Where("", "", which, "door"))
    asset = world.assets["wardrobe_0"]
    assert sign * (asset.joint(bar.joint).position_m[1] + bar.position_m[1]) > 0.0


@pytest.mark.parametrize(
    ("thing", "where"),
    [
        ("cabinet_0", "fifth drawer"),
        ("cabinet_0", "left drawer"),
        ("wardrobe_0", "top drawer"),
        ("cabinet_0", "top door"),
    ],
)
def test_a_part_that_a_thing_does_not_have_is_refused_before_any_search(world: World, thing: str, where: str) -> None:
    is_open = bddl.Atom("open", (thing,))
    opening = SimpleTask(
        "open", "Open it.", thing, None, None, bddl.Not(is_open), is_open, (), where=Where.parse(where)
    )
    task = Task("open", "Open it.", is_open, True, (opening,), {}, world.scene)
    refused = first_misfit(task, world)
    assert refused is not None and refused[2].kind.value == "no-such-part" and where in refused[2].message


def test_a_closed_part_is_read_as_closed(world: World) -> None:
    is_open = bddl.Atom("open", ("cabinet_0",))
    top = Where("", "", "top", "drawer")
    closing = SimpleTask("close", "", "cabinet_0", None, None, is_open, bddl.Not(is_open), (), where=top)
    (reading,) = read_where(closing, world)
    assert reading.satisfied
    (other,) = read_where(replace(closing, goal=is_open), world)
    assert not other.satisfied


def test_what_a_part_does_not_allow_is_no_fact_about_its_thing_and_no_reason_to_forget_it() -> None:
    scene = _scene()
    found = feasible(compose(llm.propose("put the can on the sixth shelf of the shelf", scene).task), scene, vary=False)
    assert not found.feasible and found.known == () and found.detours == ()
    assert "it has" in found.reason and "drawers" not in found.reason


def grid(*places: tuple[float, float]) -> Any:
    """A thing with doors whose handles are at (y, z)."""
    handles = [SimpleNamespace(joint=f"door_{n}", position_m=(0.0, y, z)) for n, (y, z) in enumerate(places)]
    joint = SimpleNamespace(kind="revolute", opens=True, position_m=(0.0, 0.0, 0.0))
    return SimpleNamespace(handles=handles, regions=(), joints=[joint] * len(places), joint=lambda _: joint)


@pytest.mark.parametrize(
    ("which", "places"),
    [("left", (0, 2)), ("right", (1, 3)), ("top", (0, 1)), ("last", (2, 3)), ("second", (0, 1, 2, 3)), ("fifth", ())],
)
def test_a_word_that_fits_several_doors_of_a_grid_chooses_none(which: str, places: tuple[int, ...]) -> None:
    asset = grid((0.3, 1.0), (-0.3, 1.0), (0.3, 0.5), (-0.3, 0.5))
    where, thing = Where("", "", which, "door"), SimpleNamespace(assets={"box_0": asset})
    assert parts_named(asset, where) == tuple(f"door_{place}" for place in places)
    assert handles_of(thing, "box_0", where) == ()  # type: ignore[arg-type]
    is_open = bddl.Atom("open", ("box_0",))
    refused = no_part(
        thing,  # type: ignore[arg-type]
        SimpleTask("open", "", "box_0", None, None, bddl.Not(is_open), is_open, (), where=where),
    )
    assert refused is not None
    assert all(f"door_{place}" in refused.message for place in places)


def test_boards_of_one_height_behind_two_doors_are_one_shelf() -> None:
    places = {"l0": (0.3, 1.0), "r0": (-0.3, 1.0), "l1": (0.3, 0.5), "r1": (-0.3, 0.5)}
    boards: list[Any] = [
        Region(name, "interior", "body", (0.0, y, z + 0.1), (0.2, 0.2, 0.1), (-1.0, 0.0, 0.0))
        for name, (y, z) in places.items()
    ]
    thing: Any = SimpleNamespace(assets={"box_0": SimpleNamespace(handles=())})
    found = {
        which: [region.name for region in regions_of(thing, "box_0", boards, Where("", "", which, "shelf"))]
        for which in ("top", "second", "third", "left")
    }
    assert found == {"top": ["l0", "r0"], "second": ["l1", "r1"], "third": [], "left": []}


def test_boards_that_are_missing_are_not_counted_as_doors(world: World) -> None:
    on = bddl.Atom("ontop", ("can_0", "shelf_0"))
    held, where = bddl.Atom("inside", ("can_0", GRIPPER)), Where("", "", "sixth", "shelf")
    refused = no_part(world, SimpleTask("put", "", "can_0", None, "shelf_0", held, on, (), where=where))
    assert refused is not None and "shelves" in refused.message and "door" not in refused.message


def test_boards_are_counted_from_the_top(world: World) -> None:
    boards = [region for region in world.assets["shelf_0"].regions if abs(region.opening[2]) < 0.5]
    (top,) = regions_of(world, "shelf_0", boards, Where("", "", "top", "shelf"))
    assert top.floor_m[2] == max(region.floor_m[2] for region in boards)


@pytest.mark.parametrize("yaw_deg", [0.0, 40.0])
@pytest.mark.parametrize(
    ("relation", "ahead", "left"),
    [("next to", 0, 0), ("left of", 0, 1), ("right of", 0, -1), ("behind", 1, 0), ("in front of", -1, 0)],
)
def test_spots_are_on_the_named_side_and_the_detector_agrees(
    relation: str, ahead: int, left: int, yaw_deg: float
) -> None:
    on = bddl.Atom("ontop", ("can_0", "table_0"))
    where = Where(relation, "mug_0")
    put = SimpleTask("put", "", "can_0", None, "table_0", bddl.Atom("inside", ("can_0", GRIPPER)), on, (), where=where)
    scene, c, s = _scene(yaw_deg), np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    mugs = World(scene, oracle=True)
    spots = regions_next_to(mugs, "can_0", "table_0", mugs.assets["table_0"].regions, where)
    assert spots
    mug = np.array(scene["mug_0"].position)
    for spot in spots[::3]:
        at = (np.array([*scene["table_0"].position[:2], 0.0]) + np.array(spot.center_m))[:2]
        apart = at - mug[:2]
        if ahead or left:
            assert apart @ np.array([c * ahead - s * left, s * ahead + c * left]) > 0.5 * np.linalg.norm(apart)
        sides = np.array(scene["mug_0"].extent_m[:2]) + np.array(scene["can_0"].extent_m[:2])
        gap_m = np.linalg.norm(np.maximum(np.abs(apart) - sides / 2, 0.0))
        assert 0.0 < gap_m < 0.06
        height_m = scene["mug_0"].position[2]
        ends = ends_at_side(mugs, "can_0", where)
        assert ends(transform(np.eye(3), [*at, height_m]))
        assert not ends(transform(np.eye(3), [*(at + 0.05 * apart / np.linalg.norm(apart)), height_m]))
        x, y = map(float, at)
        moved = replace(scene["can_0"], position=(x, y, scene["can_0"].position[2]))
        with World(replace(scene, objects={**scene.objects, "can_0": moved}), oracle=True) as world:
            (reading,) = read_where(put, world)
            assert reading.satisfied
            (other,) = read_where(replace(put, where=Where(relation, "cabinet_0")), world)
            assert not other.satisfied
    mugs.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("put the can to the left of the mug", "can_0 left of mug_0"),
        ("open the second drawer of the cabinet", "second drawer"),
    ],
)
def test_parts_and_spots_come_about_in_physics(query: str, said: str) -> None:
    scene = _scene()
    graph = compose(llm.propose(query, scene).task, scene=scene)
    planned = feasible(graph, scene, 0, vary=False)
    assert planned.feasible, planned.reason
    done = rollout(compose(planned.task, scene=scene), scene, 0, vary=False, conditions=planned.conditions())
    assert done.succeeded
    assert any(reading.literal == said and reading.satisfied for reading in done.subtasks[-1].readings)
