"""What the packages promise in `__all__` is there, and what the design calls stable is promised."""

from __future__ import annotations

import ast
import importlib
import importlib.util
from dataclasses import replace

import pytest

import llm
import oag
from executor.data.episode import Episode
from executor.rollouts.evolution_record import Evolution
from executor.scenes.file import load_scene
from oag.revision import Attempt, History, Revision
from tests.executor.recordings import invented_rollout
from tests.source_tree import PACKAGES, ROOT

STABLE = {
    "bddl": {"parse", "parse_formula", "format", "evaluate", "BDDLError", "Problem", "Diagnostic"},
    "oag": {"Scene", "Task", "compose", "recheck", "canonical", "Verdict", "Primitive", "Action"},
    "llm": {"propose", "QueryError"},
    "executor": {"rollout"},
}


@pytest.mark.parametrize("package", PACKAGES)
def test_every_promised_name_exists(package: str) -> None:
    module = importlib.import_module(package)
    promised = module.__all__
    assert len(promised) == len(set(promised))
    assert not [name for name in promised if not hasattr(module, name)]


@pytest.mark.parametrize("package", PACKAGES)
def test_the_stable_surface_is_promised(package: str) -> None:
    assert STABLE[package] <= set(importlib.import_module(package).__all__)


@pytest.mark.parametrize("package", PACKAGES)
def test_this_project_is_what_gets_imported(package: str) -> None:
    """The packages share names with others on the package index; a foreign one would be found first here."""
    spec = importlib.util.find_spec(package)
    assert spec is not None and spec.origin == str(ROOT / package / "__init__.py")


@pytest.mark.parametrize("package", PACKAGES)
def test_types_are_shipped(package: str) -> None:
    assert (ROOT / package / "py.typed").is_file()


LAZY = [package for package in PACKAGES if hasattr(importlib.import_module(package), "_PLACES")]


def _names_for_type_checkers(package: str) -> dict[str, tuple[str, str]]:
    """Return what a package imports for type checkers only: for each name, its module and its name there."""
    source = (ROOT / package / "__init__.py").read_text(encoding="utf-8")
    guarded = [node for node in ast.parse(source).body if isinstance(node, ast.If)]
    imports = [line for node in guarded for line in node.body if isinstance(line, ast.ImportFrom)]
    return {alias.asname or alias.name: (line.module or "", alias.name) for line in imports for alias in line.names}


def test_packages_that_load_late_are_examined() -> None:
    assert {"bddl", "oag"} <= set(LAZY)


@pytest.mark.parametrize("package", LAZY)
def test_what_is_loaded_late_is_what_type_checkers_see_and_what_is_promised(package: str) -> None:
    module = importlib.import_module(package)
    places = {name: place if isinstance(place, tuple) else (place, name) for name, place in module._PLACES.items()}
    assert places == _names_for_type_checkers(package)
    assert set(places) <= set(module.__all__)
    for name, (place, own_name) in places.items():
        assert getattr(module, name) is getattr(importlib.import_module(place), own_name)
        assert name in dir(module)


@pytest.mark.parametrize("package", LAZY)
def test_a_name_that_does_not_exist_is_an_attribute_error(package: str) -> None:
    with pytest.raises(AttributeError, match=f"module '{package}' has no attribute 'nothing'"):
        _ = importlib.import_module(package).nothing


def test_what_is_handed_out_shows_itself_in_a_short_line() -> None:
    recorded = invented_rollout()
    graph = oag.compose(recorded.task, scene=recorded.scene)
    report = graph.verify()
    proposal = llm.propose("open the refrigerator", load_scene("kitchen_t1"))
    shown = {
        kind: repr(value)
        for kind, value in (
            ("Scene", recorded.scene), ("Task", recorded.task), ("ObjectActionGraph", graph), ("Report", report),
            ("Certificate", report.certificate), ("Proposal", proposal), ("Rollout", recorded),
            ("Evolution", Evolution(recorded.task, recorded, ())), ("Episode", Episode.from_rollout(recorded)),
        )
    }  # fmt: skip
    for kind, line in shown.items():
        assert line.startswith(f"<{kind} ") and line.endswith(">") and "\n" not in line and len(line) < 300, line
    assert f"{recorded.scene.name!r}: {len(recorded.scene.objects)} objects" in shown["Scene"]
    assert f"{report.verdict.value} of <Task {recorded.task.name!r}" in shown["Report"]
    assert "succeeded" in shown["Rollout"] and "failed" in repr(invented_rollout(failed=True))


def test_the_core_offers_thirty_names_at_most_and_shows_no_others() -> None:
    shown = [name for name in dir(oag) if not name.startswith("_")]
    assert shown == sorted(oag.__all__) and len(shown) <= 30


@pytest.mark.parametrize("name", oag._MOVED)
def test_what_has_moved_says_where_it_is(name: str) -> None:
    with pytest.warns(DeprecationWarning, match=f"from {oag._MOVED[name]} import {name}"):
        found = getattr(oag, name)
    assert found is getattr(importlib.import_module(oag._MOVED[name]), name)
    assert name not in oag.__all__


def test_records_of_the_core_show_themselves_in_two_hundred_characters() -> None:
    long = "x" * 150
    objects = {f"{long}_{number}": "apple" for number in range(3)} | {f"{long}_table": "table", f"{long}_d": "drawer"}
    facts = [f"(ontop {long}_{number} {long}_table)" for number in range(3)]
    scene = oag.scene(objects, facts, "all", name=long)
    steps = [oag.open(f"{long}_d"), oag.pick(f"{long}_0"), oag.place(f"{long}_0", inside=f"{long}_d")]
    task = oag.task(scene, steps=steps, goal=f"(and (inside {long}_0 {long}_d) (not (open {long}_d)))", name=long)
    graph = oag.compose(task)
    report, right = graph.verify(), oag.compose(replace(task, goal=f"(open {long}_d)")).verify()
    assert report.verdict is oag.Verdict.REFUTED and report.fixes and right
    attempt = Attempt(task.subtasks[0].flow or (), "failed", failure=long)
    revision = Revision(task.subtasks[1].flow or (), "sequence", long)
    history = History(0).add(attempt, revision)
    stable = oag.stability(lambda query, scene: task, long * 2, scene, 3)
    records = [
        scene, scene.objects[f"{long}_0"], task, *task.subtasks, *steps, graph, *graph.nodes, *graph.edges, report,
        *report.diagnostics, *report.findings, *report.fixes, *report.obligations, *report.missing,
        report.counterexample, right.certificate, right.state_after(2), oag.recheck(right.certificate),
        oag.complete(task), oag.plan(scene, f"(open {long}_d)"), oag.plan(scene, f"(open {long}_table)"),
        attempt, revision, history, stable, *stable.runs, *stable.forms, stable.runs[0].setting,
        oag.Action(oag.Primitive.GRASP), oag.Primitive.GRASP, report.verdict, oag.Domain(long * 2),
    ]  # fmt: skip
    assert {type(record).__name__ for record in records} >= {
        name for name in oag.__all__ if isinstance(getattr(oag, name), type) and not name.endswith("Error")
    }
    for record in records:
        line = repr(record)
        assert 0 < len(line) <= 200 and "\n" not in line and str(type(record).__name__) in line, line
