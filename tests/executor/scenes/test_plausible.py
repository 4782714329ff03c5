"""Scenes that cannot be: each mistake is found, named and explained, and no scene of the package has any."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bddl import format
from executor.assets.library import asset_for
from executor.scenes import library
from executor.scenes.digital_cousins import from_cousins
from executor.scenes.file import complete_scene
from executor.scenes.generators import long_horizon
from executor.scenes.validation import issues, require_valid
from oag import Scene, SceneError
from tests.executor.scenes.reconstructions import kitchen, write
from tests.oag.paper import NAMES, scene

Change = Callable[[dict[str, Any]], object]


def changed(change: Change, name: str = "kitchen_t1") -> Scene:
    """A scene of the package with a mistake in it."""
    data = copy.deepcopy(library.load(name).to_json())
    change(data)
    return Scene.from_json(data)


def move(key: str, *position: float) -> Change:
    def change(data: dict[str, Any]) -> None:
        data["objects"][key]["position"] = list(position)

    return change


def state(*facts: str) -> Change:
    return lambda data: data.update(facts=list(facts))


def add(key: str, like: str, **fields: Any) -> Change:
    return lambda data: data["objects"].update({key: {**data["objects"][like], **fields}})


@pytest.mark.parametrize("name", library.names())
def test_the_packages_scenes_have_no_flaw(name: str) -> None:
    assert issues(library.load(name)) == ()


@pytest.mark.parametrize("name", NAMES)
def test_the_tests_own_scenes_have_no_flaw(name: str) -> None:
    assert issues(scene(name)) == ()


def test_a_reconstruction_has_no_error(tmp_path: Path) -> None:
    found = issues(from_cousins(write(tmp_path, kitchen())).scene)
    assert not [str(issue) for issue in found if issue.error]


@pytest.mark.slow
@pytest.mark.physics
@pytest.mark.parametrize("family", NAMES)
def test_drawn_kitchens_have_no_error(family: str) -> None:
    found = issues(long_horizon.draw(family, 12000).scene)
    assert not [str(issue) for issue in found if issue.error]


@pytest.mark.slow
@pytest.mark.physics
@pytest.mark.parametrize("index", [0, 9, 40, 60, 101])
def test_household_rooms_have_no_error(index: int) -> None:
    from executor.scenes.generators import household

    found = issues(household.pair(13000, index).scene)
    assert not [str(issue) for issue in found if issue.error]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (move("glass_0", 0.0, -1.12, 1.9), "glass_0 is in mid-air: 124.0 cm above table_0"),
        (move("glass_0", 3.0, 3.0, 0.66), "glass_0 is in mid-air: 60.0 cm above the floor"),
        (move("glass_0", 0.0, -1.12, -0.2), "glass_0 is 26.0 cm deep in the floor"),
        (move("glass_0", 3.0, 3.0, 0.06), "glass_0 is not on table_0, as the facts say (ontop glass_0 table_0)"),
        (move("table_0", 0.94, 0.0, 0.3), "refrigerator_0 and table_0 overlap by"),
        (add("glass_1", "glass_0"), "glass_0 and glass_1 overlap by 7.0 cm"),
        (
            state("(ontop glass_0 table_0)", "(inside glass_0 refrigerator_0)"),
            "glass_0 is not in refrigerator_0 by its position, and the facts say (inside glass_0 refrigerator_0)",
        ),
        (state("(not (ontop glass_0 table_0))"), "glass_0 is on table_0 by its position, and the facts say (not"),
        (state("(open refrigerator_0)"), "refrigerator_0 is shut by its parameter open_fraction (0.0)"),
        (
            lambda data: data["objects"]["glass_0"].update(category="glas", model="glas"),
            "glass_0 (glas): no family builds this category; did you mean glass?",
        ),
        (
            lambda data: data["objects"]["refrigerator_0"].update(parameters={"hinge": "top"}),
            "refrigerator_0 (refrigerator): parameter 'hinge' is 'top'; expected one of left, right",
        ),
    ],
)
def test_a_mistake_is_an_error_that_names_it(change: Change, said: str) -> None:
    found = [str(issue) for issue in issues(changed(change)) if issue.error]
    assert any(issue.startswith(said) for issue in found), found


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (move("glass_0", 0.0, -1.12, 0.69), "glass_0 will fall: 3.0 cm above table_0"),
        (state(), "glass_0 is on table_0 by its position, and no fact says (ontop glass_0 table_0)"),
    ],
)
def test_what_physics_will_settle_is_a_warning(change: Change, said: str) -> None:
    assert [(str(issue), issue.error) for issue in issues(changed(change))] == [(said, False)]


def test_an_apple_in_a_bowl_overlaps_nothing() -> None:
    bowl = library.load("kitchen_t3")["bowl_0"]
    x, y, z = bowl.position
    inside = changed(move("apple_0", x, y, z + 0.02), "kitchen_t3")
    assert not [str(issue) for issue in issues(inside) if "overlap" in str(issue) or "mid-air" in str(issue)]


def test_all_that_cannot_be_built_is_said_at_once() -> None:
    def change(data: dict[str, Any]) -> None:
        for key, category in (("glass_0", "unicorn"), ("table_0", "chandelier")):
            data["objects"][key].update(category=category, model=category)

    with pytest.raises(SceneError) as caught:
        require_valid(changed(change))
    assert "2 things are wrong" in str(caught.value)
    assert "glass_0 (unicorn)" in str(caught.value) and "table_0 (chandelier)" in str(caught.value)


@pytest.mark.slow
def test_a_crowd_of_things_is_compared_with_its_neighbours() -> None:
    """Every pair of 300 things, each built anew for it, would take hours."""

    def change(data: dict[str, Any]) -> None:
        apple = {"category": "apple", "bbox_extent": [0.07, 0.07, 0.07]}
        for n in range(300):
            data["objects"][f"apple_{n}"] = apple | {"position": [5.0 + 0.2 * (n % 25), 5.0 + 0.2 * (n // 25), 0.035]}
        data["objects"]["apple_300"] = apple | {"position": [5.03, 5.0, 0.035]}

    assert [str(issue) for issue in issues(changed(change))] == ["apple_0 and apple_300 overlap by 4.0 cm"]


HALF = math.sqrt(0.5)


@pytest.mark.parametrize(
    ("orientation", "low_m"),
    [
        ((HALF, 0.0, HALF, 0.0), 0.03),
        ((HALF, HALF, 0.0, 0.0), 0.03),
        # Rolled about its own axis, and turned as it lies.
        (tuple(Rotation.from_euler("zyz", [0.7, math.pi / 2, 0.4]).as_quat(scalar_first=True).tolist()), 0.03),
        ((0.0, 1.0, 0.0, 0.0), 0.12),
    ],
)
@pytest.mark.parametrize("where", ["table", "floor", "refrigerator", "edge", "air"])
def test_what_fell_over_is_on_or_in_what_it_lies_on(orientation: tuple[float, ...], low_m: float, where: str) -> None:
    """The bottle is 24 cm tall and 6 cm across, and the same goes for it upside down."""
    table = {"category": "table", "position": [1.2, 0.0, 0.35], "bbox_extent": [0.8, 1.2, 0.7]}
    fridge = {"category": "refrigerator", "position": [1.2, 2.0, 0.85], "bbox_extent": [0.7, 0.7, 1.7]}
    x, y, z = {"table": (1.2, 0.2, 0.7), "edge": (1.65, 0.0, 0.7), "air": (1.2, 0.2, 0.85)}.get(where, (-1.5, 0.0, 0.0))
    objects = {"table_0": table, "refrigerator_0": fridge}
    if where == "refrigerator":
        empty = complete_scene({"name": "s", "objects": objects}).scene
        assert empty is not None
        regions = asset_for(empty.objects["refrigerator_0"]).regions
        x, y, z = np.add(regions[0].floor_m, fridge["position"])
    bottle = {"category": "bottle", "bbox_extent": [0.06, 0.06, 0.24], "position": [x, y, z + low_m]}
    bottle |= {"orientation": list(orientation)}
    scene = complete_scene({"name": "s", "objects": objects | {"bottle_0": bottle}}).scene
    assert scene is not None
    about = {format(fact) for fact in scene.facts if "bottle_0" in format(fact)}
    fallen = {"(can_stand bottle_0)", "(not (upright bottle_0))"}
    place = {"table": "ontop bottle_0 table_0", "floor": "ontop bottle_0 floor"}
    place["refrigerator"] = "inside bottle_0 refrigerator_0"
    assert about == fallen | ({f"({place[where]})"} if where in place else set())
