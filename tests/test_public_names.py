"""What the packages promise in `__all__` is there, and what the design calls stable is promised."""

from __future__ import annotations

import ast
import importlib
import importlib.util

import pytest

import llm
import oag
from executor.data.episode import Episode
from executor.rollouts.evolution_record import Evolution
from executor.scenes.file import load_scene
from tests.executor.recordings import invented_rollout
from tests.source_tree import PACKAGES, ROOT

STABLE = {
    "bddl": {"parse", "parse_formula", "format", "evaluate", "BDDLError", "Problem", "Diagnostic"},
    "oag": {"Scene", "Task", "compose", "recheck", "Verdict", "Primitive", "Action"},
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
