"""What has no surface of its own bears things on its flat top or its rim, where sizes allow it."""

from __future__ import annotations

import math
from typing import Any

import pytest

import bddl
import llm
from oag import Scene
from oag.model.robots import LIFTED

LEANING = (math.cos(math.pi / 4), math.sin(math.pi / 4), 0.0, 0.0)


def _thing(category: str, extent: tuple[float, float, float], x_m: float, **more: Any) -> dict[str, Any]:
    pose = {"position": [x_m, 0.0, 0.75 + extent[2] / 2], "orientation": [1.0, 0.0, 0.0, 0.0]}
    return {"category": category, "model": category, **pose, "bbox_extent": list(extent), **more}


@pytest.fixture(scope="module")
def scene() -> Scene:
    sizes: dict[str, tuple[str, tuple[float, float, float]]] = {
        "apple_0": ("apple", (0.073, 0.073, 0.073)),
        "plum_0": ("plum", (0.05, 0.05, 0.05)),
        "fork_0": ("fork", (0.18, 0.025, 0.01)),
        "carton_0": ("box", (0.15, 0.072, 0.12)),
        "cup_0": ("cup", (0.061, 0.061, 0.09)),
        "bowl_0": ("bowl", (0.14, 0.14, 0.06)),
        "can_0": ("can", (0.061, 0.061, 0.12)),
        "die_0": ("die", (0.04, 0.04, 0.04)),
        "bottle_0": ("bottle", (0.06, 0.06, 0.2)),
        "medicine_0": ("medicine_bottle", (0.05, 0.05, 0.09)),
        "teddy_bear_0": ("teddy_bear", (0.15, 0.18, 0.24)),
    }
    things = {key: _thing(kind, size, 0.3 * n) for n, (key, (kind, size)) in enumerate(sizes.items())}
    things["mug_0"] = _thing("mug", (0.11, 0.08, 0.09), -0.3, orientation=list(LEANING))
    things["small_die_0"] = _thing("die", (0.02, 0.02, 0.02), -0.6)
    table = _thing("table", (4.0, 1.0, 0.75), 1.5)
    facts = [f"(ontop {key} table_0)" for key in things]
    objects = {**things, "table_0": table}
    document = {"name": "tops", "objects": objects, "facts": facts, "closed": ["ontop", "inside", "open"]}
    return Scene.from_json(document).with_robot(LIFTED.name)


@pytest.mark.parametrize(
    ("query", "goal"),
    [
        ("pile the apple onto the cup", ("apple_0", "cup_0")),
        ("balance the carton on the cup", ("carton_0", "cup_0")),
        ("put the carton onto the bowl", ("carton_0", "bowl_0")),
        ("stack the cup on the can", ("cup_0", "can_0")),
        ("put die_0 onto the can", ("die_0", "can_0")),
        ("put the can on top of die_0", ("can_0", "die_0")),
        ("put die_0 on top of the medicine", ("die_0", "medicine_0")),
    ],
)
def test_what_is_wide_enough_is_put_onto_a_rim_and_anything_onto_a_flat_top(
    query: str, goal: tuple[str, str], scene: Scene
) -> None:
    assert llm.propose(query, scene).task.goal == bddl.Atom("ontop", goal)


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("put the plum onto the cup", "plum_0 is 5.0 x 5.0 cm from above, and cup_0 6.1 cm wide"),
        ("put the apple onto the bowl", "apple_0 is 7.3 x 7.3 cm from above, and bowl_0 14.0 cm wide"),
        ("put the fork onto the cup", "fork_0 is 18.0 x 2.5 cm from above, and cup_0 6.1 cm wide"),
        ("put the plum onto small_die_0", "the top of small_die_0 is 2.0 cm wide"),
        ("put die_0 onto the apple", "apple_0 (apple) has no surface to put something onto"),
        ("put the apple onto the teddy", "teddy_bear_0 (teddy_bear) has no surface to put something onto"),
        ("put the apple onto bottle_0", "bottle_0 (bottle) has no surface to put something onto"),
        ("put the carton onto the mug", "mug_0 (mug) has no surface to put something onto"),
    ],
)
def test_what_is_too_narrow_for_a_rim_or_a_top_too_small_is_refused_with_the_sizes(
    query: str, words: str, scene: Scene
) -> None:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose(query, scene)
    assert caught.value.code == "affordance"
    assert words in str(caught.value)


def test_a_thing_that_would_fall_into_a_bowl_is_put_into_it_instead(scene: Scene) -> None:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose("put the apple onto the bowl", scene)
    assert "put apple_0 into bowl_0" in caught.value.suggestions
