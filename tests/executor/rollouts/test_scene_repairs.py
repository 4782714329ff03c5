"""Scenes repaired: a refused, refuted or infeasible wish becomes feasible by a small change, which is recorded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

import bddl
import llm
from executor.campaign.versions import outcome_version
from executor.cli.app import run
from executor.data.generation import series_of
from executor.data.store import EpisodeStore
from executor.data.units import DemoUnit
from executor.data.worker import run_unit
from executor.rollouts.scene_repairs import Judged, repaired
from executor.scenes.changes import elsewhere, place_of, supports_near, with_door, without
from executor.scenes.file import complete_scene
from executor.scenes.generators import any_task
from executor.scenes.library import load
from executor.scenes.room import NoRoom
from executor.scenes.validation import settle
from executor.system.files import read_json
from oag import Scene, SceneObject
from oag.model.infeasible import Infeasible
from oag.sizes import Sizing

pytestmark = pytest.mark.physics
ALREADY_SO = "put the glass onto the table"


def kitchen() -> Scene:
    return replace(load("kitchen_t1"), variation={})


def with_another(scene: Scene, name: str, like: str, dx_m: float) -> Scene:
    """The scene with a copy of an object on the same support."""
    thing = scene[like]
    x, y, z = thing.position
    objects = {**scene.objects, name: replace(thing, id=name, position=(x + dx_m, y, z))}
    return replace(scene, objects=objects, facts=(*scene.facts, bddl.Atom("ontop", (name, "table_0"))))


def asked(query: str, scene: Scene) -> Judged:
    return repaired(scene, lambda other: llm.propose(query, other).task, 0)


def test_a_feasible_wish_changes_nothing() -> None:
    scene = kitchen()
    found = asked("open the refrigerator", scene)
    assert found.feasible and not found.fixes and found.scene == scene and found.reason == ""


def test_a_door_that_is_open_already_is_shut_first() -> None:
    found = asked("open the refrigerator", with_door(kitchen(), "refrigerator_0", is_open=True))
    assert found.feasible and [fix.kind for fix in found.fixes] == ["door"]
    assert found.fixes[0].objects == ("refrigerator_0",) and found.fixes[0].reason == "already-so"
    assert bddl.Not(bddl.Atom("open", ("refrigerator_0",))) in found.scene.facts


@pytest.mark.slow
def test_of_two_things_of_a_name_one_is_removed() -> None:
    found = asked("pick up the glass", with_another(kitchen(), "glass_1", "glass_0", 0.2))
    assert found.feasible and [fix.kind for fix in found.fixes] == ["removed"]
    (gone,) = found.fixes[0].objects
    assert gone in ("glass_0", "glass_1") and gone not in found.scene.objects
    assert not any(gone in atom.args for fact in found.scene.facts for atom in bddl.atoms(fact))


@pytest.mark.slow
def test_a_plan_of_another_start_is_refuted_until_the_thing_is_where_it_was() -> None:
    scene = kitchen()
    task = llm.propose(ALREADY_SO.replace("onto the table", "into the refrigerator"), scene).task
    moved = settle(elsewhere(scene, "glass_0", "refrigerator_0", "inside"))
    found = repaired(moved, lambda other: task, 0)
    assert found.feasible and [fix.kind for fix in found.fixes] == ["place"]
    assert place_of(found.scene, "glass_0") == ("table_0", "ontop") and found.fixes[0].reason == "refuted"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "kinds"),
    [
        (73009, ["removed", "place"]),  # The bowl is on the cabinet that is left.
        (73016, ["removed"]),  # Without the other table the sentence has two readings.
        (73003, ["removed", "place"]),  # What stands on the other cabinets is needed.
    ],
)
def test_a_change_that_leads_no_further_is_given_up_for_the_next(seed: int, kinds: list[str]) -> None:
    wish = any_task.draw(seed)
    found = repaired(wish.scene, lambda scene: llm.propose(wish.query, scene, sizing=Sizing(seed)).task, seed)
    assert found.feasible and [fix.kind for fix in found.fixes] == kinds
    assert found.fixes[0].reason == "ambiguous-object"


def test_what_no_scene_mends_is_left_as_it_is() -> None:
    scene = kitchen()
    found = asked("pour the glass into the refrigerator", scene)
    assert not found.feasible and found.scene == scene and not found.fixes and found.reason == "unknown-action"


def moved_scenes(scene: Scene) -> Iterator[Scene]:
    """Every change that the repairs make of a thing, a door and an object."""
    for support, relation in supports_near(scene, "glass_0"):
        for number in range(3):
            yield elsewhere(scene, "glass_0", support, relation, number)
    yield with_door(scene, "refrigerator_0", is_open=True)
    yield without(scene, ["table_0"])


def test_changed_scenes_hold_in_physics_and_agree_with_their_facts() -> None:
    scene = kitchen().with_scales({"glass_0": 0.7})
    for changed in moved_scenes(scene):
        settle(changed)  # Raises where a fact and the detectors disagree, or where something falls.
    gone = without(scene, ["table_0"])
    assert set(gone.objects) == {"refrigerator_0"} and not any("glass_0" in str(fact) for fact in gone.facts)


def test_a_changed_scene_knows_nothing_that_geometry_found_before() -> None:
    scene = kitchen().knowing([Infeasible("take", "glass_0", given=(bddl.Atom("ontop", ("glass_0", "table_0")),))])
    changed = [
        without(scene, ["glass_0"]),
        elsewhere(scene, "glass_0", "table_0", "ontop"),
        with_door(scene, "refrigerator_0", is_open=True),
    ]
    assert scene.known and not any(each.known for each in changed)


def test_nothing_is_moved_over_the_floor() -> None:
    scene = scene_of_floor()
    assert place_of(scene, "can_0") == ("floor", "ontop")
    with pytest.raises(NoRoom, match="between furniture"):
        elsewhere(scene, "can_0", "floor", "ontop")


def scene_of_floor() -> Scene:
    things = {
        "table_0": {"category": "table", "position": [3.0, 0.0]},
        "can_0": {"category": "can", "position": [1.0, 0.0], "on": "floor"},
    }
    found = complete_scene({"robot": {"position": [-1, 0]}, "objects": things}).scene
    assert found is not None
    return found


def test_what_carries_something_stays_where_it_is() -> None:
    scene = kitchen()
    x, y, z = scene["glass_0"].position
    die = SceneObject("die_0", "die", "die", (x, y, z), (1, 0, 0, 0), (0.02, 0.02, 0.02), (1, 1, 1))
    facts = (*scene.facts, bddl.Atom("inside", ("die_0", "glass_0")))
    with pytest.raises(NoRoom):
        elsewhere(replace(scene, objects={**scene.objects, "die_0": die}, facts=facts), "glass_0", "table_0", "ontop")


def test_the_option_goes_with_the_offline_planner_alone(tmp_path: Path) -> None:
    words = ["run", ALREADY_SO, "--scene", "kitchen_t1", "--repair", "scene", "--out", str(tmp_path / "r")]
    assert run([*words, "--anyway"]) == run([*words, "--evolve"]) == 2
    assert run([*words[:-3], "walls", "--out", str(tmp_path / "r")]) == 2
    assert not (tmp_path / "r").exists()


def unit(**more: object) -> DemoUnit:
    plan = {"sources": [{"query": ALREADY_SO, "scene": "kitchen_t1", "episodes": 1, **more}]}
    return series_of(plan)[0].first


def test_a_unit_says_that_its_scene_may_be_changed() -> None:
    plain, repairing = unit(), unit(repair="scene")
    assert "repair" not in plain.to_json() and repairing.to_json()["repair"] == "scene"
    assert DemoUnit.from_json(repairing.to_json()) == repairing and plain.id("v") != repairing.id("v")
    with pytest.raises(ValueError, match="not revised"):
        replace(repairing, evolve=True)


@pytest.mark.parametrize("axes", [["--vary", "target"], ["--distractors", "2"]])
def test_a_repaired_scene_gets_neither_another_target_nor_distractors(
    axes: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["generate", ALREADY_SO, "--scene", "kitchen_t1", "--repair", "scene", "--out", str(tmp_path / "s")]
    assert run([*words, *axes]) == 2 and not (tmp_path / "s").exists()
    assert "need a plan before the repair" in " ".join(capsys.readouterr().err.split())


@pytest.mark.slow
def test_every_episode_says_what_was_changed(tmp_path: Path) -> None:
    store, version = EpisodeStore(tmp_path / "store"), outcome_version()
    assert run_unit(store, unit(), version)["kind"] == "not-planned"
    assert run_unit(store, unit(repair="scene"), version)["ended"] == "succeeded"
    meta = next(store.demonstrations()).meta
    assert [fix["kind"] for fix in meta["scene_fixes"]] == ["place"]
    out = tmp_path / "run"
    words = ["run", ALREADY_SO, "--scene", "kitchen_t1", "--repair", "scene", "--no-video", "--out", str(out)]
    assert run(words) == 0
    assert read_json(out / "rollout.json")["scene_fixes"][0]["reason"] == "already-so"
    assert "the scene was changed" in (out / "report.html").read_text(encoding="utf-8")
