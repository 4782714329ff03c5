"""Scene files with a button or a knob: what follows from them, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

import bddl
import oag
from executor.assets.asset_geometry import bounds
from executor.assets.library import asset_for, sample
from executor.assets.model import Control
from executor.scenes.changes import has_one_way, with_door
from executor.scenes.file import complete_scene
from tests.executor.appliances import CONTROLS, KINDS, appliance


def completed(*, domain: oag.Domain | None = None, **objects: dict[str, Any]) -> oag.Scene:
    data = {"name": "one", "robot": {"position": [-0.5, 0.0]}, "objects": objects}
    found = complete_scene(data) if domain is None else complete_scene(data, domain)
    assert found.scene is not None, found.problems
    return found.scene


def facts(scene: oag.Scene) -> set[str]:
    return {bddl.format(fact) for fact in scene.facts}


def test_a_scene_with_a_control_has_the_domain_and_says_what_is_on() -> None:
    scene = appliance("oven", "knob", 0)
    assert scene.domain == oag.Domain.appliances()
    assert {"(has_knob oven_0)", "(not (toggled_on oven_0))", "(not (open oven_0))"} <= facts(scene)
    assert {"has_button", "has_knob", "toggled_on"} <= scene.closed
    on = appliance("lamp", "button", 0, switched="on")
    assert {"(has_button lamp_0)", "(toggled_on lamp_0)"} <= facts(on)
    assert oag.Scene.from_json(on.to_json()).domain == on.domain


def test_a_scene_without_one_is_what_it_was() -> None:
    scene = completed(oven_0={"category": "oven", "position": [1.0, 0.0]})
    assert scene.domain.built_in and facts(scene) == {"(not (open oven_0))"}
    assert scene.closed == {"ontop", "inside", "open"}


def test_an_own_domain_stays_and_loses_nothing() -> None:
    rows = {"WAVE": {"objects": {"?a": "object"}, "needs": ["(handempty)"], "writes": ["(free)"]}}
    own = oag.Domain.from_json({"name": "waving", "primitives": rows})
    oven = {"category": "oven", "position": [1.0, 0.0], "parameters": {"control": "knob"}}
    scene = completed(domain=own, oven_0=oven)
    assert scene.domain == own
    # The predicate is BEHAVIOR's, which this domain inherits; what an oven has is not.
    assert facts(scene) == {"(not (open oven_0))", "(not (toggled_on oven_0))"}


def test_a_lamp_with_a_button_has_to_be_fixed_and_words_are_checked() -> None:
    for parameters, words in (({"control": "button"}, '"fixed": true'), ({"control": "lever"}, "none, button, knob")):
        lamp = {"category": "lamp", "position": [1.0, 0.0], "parameters": parameters}
        found = complete_scene({"name": "one", "objects": {"lamp_0": lamp}})
        assert found.scene is None and words in " ".join(found.problems)


@pytest.mark.parametrize(
    ("category", "parameters", "said"),
    [
        ("refrigerator", {"control": "button"}, "'control' is 'button'"),
        ("table", {"control": "knob", "switched": "on"}, "'control' is 'knob'"),
        ("microwave", {"switched": "on"}, "'switched' is 'on'"),
    ],
)
def test_a_control_that_a_model_cannot_have_is_refused(category: str, parameters: dict[str, str], said: str) -> None:
    thing = {"category": category, "position": [1.0, 0.0], "parameters": parameters}
    found = complete_scene({"name": "one", "objects": {"thing_0": thing}})
    assert found.scene is None
    assert said in found.problems[0] and "microwave_side_hinge, oven_bottom_hinge, lamp_on_stem" in found.problems[0]


def test_no_control_and_off_are_said_of_everything() -> None:
    nothing = {"control": "none", "switched": "off"}
    scene = completed(table_0={"category": "table", "position": [1.0, 0.0], "parameters": nothing})
    assert scene.domain.built_in


@pytest.mark.parametrize("control", ["none", *CONTROLS])
@pytest.mark.parametrize("kind", ["microwave", "oven"])
def test_what_has_one_door_opens_one_way_whatever_switches_it(kind: str, control: str) -> None:
    scene = appliance(kind, control, 1)
    assert has_one_way(scene, f"{kind}_0")
    opened = with_door(scene, f"{kind}_0", is_open=True)
    assert f"(open {kind}_0)" in facts(opened)


def test_a_lamp_with_a_button_opens_no_way() -> None:
    assert not has_one_way(appliance("lamp", "button", 1), "lamp_0")


def test_models_that_are_drawn_have_no_control() -> None:
    for model in ("microwave_side_hinge", "oven_bottom_hinge", "lamp_on_stem"):
        assert not any("control" in sample(model, seed).parameters for seed in range(5))
        assert not asset_for(sample(model, 0)).controls


def test_a_control_stays_within_the_box_and_closes_nothing() -> None:
    for kind in KINDS:
        for control in CONTROLS:
            thing = appliance(kind, control, 1).objects[f"{kind}_0"]
            asset = asset_for(thing)
            low, high = bounds(asset)
            assert (high - low <= [side + 1e-6 for side in thing.extent_m]).all()
            (found,) = asset.controls
            assert isinstance(found, Control) and not found.opens and found not in asset.doors
            assert all(region.joint != found.name for region in asset.regions)
            assert all(handle.joint != found.name for handle in asset.handles)


def test_what_is_fixed_in_a_scene_is_switched_all_the_same() -> None:
    thing = replace(appliance("oven", "knob", 1).objects["oven_0"], fixed=True)
    assert asset_for(thing).controls and not asset_for(thing).handles
