"""The import order bddl <- oag <- llm <- executor holds, without cycles and without hidden imports."""

from __future__ import annotations

import json
import subprocess
import sys
from functools import cache
from pathlib import Path

import networkx
import pytest

from tests.source_tree import PACKAGES, ROOT, Import, first_party_imports, modules

HEAVY = ("z3", "sapien", "torch", "openai", "pydantic", "pytorch_kinematics", "h5py", "av", "scipy", "matplotlib")


@cache
def every_import() -> tuple[Import, ...]:
    """Returns what all modules import from the project's own packages."""
    return tuple(found for name, path in modules().items() for found in first_party_imports(name, path))


# The folders of a package in a line: each imports only from itself, from those before it, and from modules beside them.
ROOMS = {
    "bddl": (
        "files",
        "visible",
        "syntax",
        "semantics",
        "goals",
        "solver",
        "reading",
        "printer",
        "parser",
        "lint",
        "analyser",
        "repair",
    ),
    "oag": (
        "model",
        "table",
        "checker",
        "task",
        "progression",
        "flows",
        "certificate",
        "explain",
        "report",
        "repairs",
        "verify",
        "graph",
        "export",
        "revision",
        "normal_form",
    ),
    "executor": (
        "geometry",
        "machine",
        "robot",
        "assets",
        "records",
        "world",
        "pictures",
        "motion",
        "primitives",
        "scenes",
        "rollouts",
        "evolution",
        "results",
        "photo",
        "bench",
        "datasets",
        "envs",
        "baselines",
        "policies",
        "cli",
        "__main__",
    ),
    "llm": (
        "errors",
        "wire",
        "answers",
        "proposal",
        "offline",
        "paraphrase",
        "modules",
        "sight",
        "evolution",
        "memory",
        "judges",
        "proposer",
    ),
    "executor.assets": (
        "model",
        "parameters",
        "resistance",
        "transforms",
        "visuals",
        "build",
        "surface",
        "parts",
        "models",
        "imports",
        "library",
        "footprint",
    ),
    "executor.photo": (
        "refusal",
        "inputs",
        "perception",
        "space",
        "fitting",
        "room",
        "tidy",
        "scene",
        "variations",
        "pipeline",
        "cousins",
        "overlay",
        "report",
        "folder",
    ),
    "executor.motion": ("planning", "grasping", "placing", "articulation"),
    "executor.cli": (
        "errors",
        "words",
        "usage",
        "output",
        "progress",
        "summary",
        "inputs",
        "executing",
        "sharing",
        "fault_words",
        "judging",
        "commands",
        "main",
    ),
}


def owner(target: str, known: dict[str, Path]) -> str:
    """Returns the module that an imported name belongs to: itself, or the module that defines it."""
    return target if target in known else target.rpartition(".")[0]


def test_every_package_is_there() -> None:
    for package in PACKAGES:
        assert (ROOT / package / "__init__.py").is_file(), f"{package} is no package"


def test_imports_go_one_way() -> None:
    upward = [
        f"{found.module}:{found.line} imports {found.target}"
        for found in every_import()
        if PACKAGES.index(found.target.split(".")[0]) > PACKAGES.index(found.module.split(".")[0])
    ]
    assert not upward, upward


@pytest.mark.parametrize("package", ROOMS)
def test_rooms_stand_in_a_line(package: str) -> None:
    order, depth = ROOMS[package], package.count(".") + 1
    parts = [name.split(".") for name in modules() if name.startswith(f"{package}.")]
    assert {names[depth] for names in parts} == set(order), "a room is not in the list, or not there any more"
    upward = [
        f"{found.module}:{found.line} imports {found.target}"
        for found in every_import()
        if found.module.startswith(f"{package}.") and found.target.startswith(f"{package}.")
        if order.index(found.target.split(".")[depth]) > order.index(found.module.split(".")[depth])
    ]
    assert not upward, upward


def test_no_first_party_import_hides_in_a_function() -> None:
    hidden = [f"{found.module}:{found.line} imports {found.target}" for found in every_import() if not found.at_top]
    assert not hidden, hidden


def test_modules_import_without_cycles() -> None:
    known = modules()
    graph = networkx.DiGraph(
        (found.module, target)
        for found in every_import()
        # An import for type checkers only counts too: it hides a cycle, it does not undo it.
        if (target := owner(found.target, known)) in known and target != found.module
    )
    cycles = [sorted(part) for part in networkx.strongly_connected_components(graph) if len(part) > 1]
    assert not cycles, cycles


def loaded_after(statement: str) -> set[str]:
    """Returns the top-level modules that a fresh process has loaded after a statement."""
    code = f"{statement}\nimport json, sys\nprint(json.dumps(sorted({{m.split('.')[0] for m in sys.modules}})))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=600, check=True
    )
    return set(json.loads(done.stdout))


@pytest.mark.parametrize("package", ["bddl", "oag", "llm"])
def test_importing_a_light_package_loads_nothing_heavy(package: str) -> None:
    loaded = loaded_after(f"import {package}")
    assert package in loaded
    assert not loaded & set(HEAVY)
    assert not loaded & set(PACKAGES[PACKAGES.index(package) + 1 :])


def test_importing_executor_loads_no_simulator() -> None:
    assert not loaded_after("import executor") & {"sapien", "torch", "pytorch_kinematics", "z3", "openai"}


def reached_from(start: str, known: dict[str, Path]) -> set[str]:
    """Returns the first-party modules that a module imports, directly or not, itself included."""
    reached: set[str] = set()
    waiting = [start]
    while waiting:
        module = waiting.pop()
        if module in known and module not in reached:
            reached.add(module)
            waiting += [owner(found.target, known) for found in first_party_imports(module, known[module])]
    return reached


# What README and docs/semantics.md say that the checker of certificates has in common with the verifier.
SHARED_WITH_THE_CHECKER = ("model.primitives", "model.facts", "model.categories", "table.library", "table.invariants")


def test_the_certificate_checker_shares_what_the_documents_say_and_no_more() -> None:
    """What `oag.recheck` shares with `verify` are mistakes that both may have."""
    reached = {module for module in reached_from("oag.checker.recheck", modules()) if module.startswith("oag.")}
    own = {module for module in reached if module.startswith("oag.checker")}
    shared = {f"oag.{name}" for name in SHARED_WITH_THE_CHECKER}
    assert reached - own - {"oag.model", "oag.table"} == shared
    semantics = (ROOT / "docs" / "semantics.md").read_text(encoding="utf-8")
    for name in shared:
        assert f"`{name}`" in semantics
