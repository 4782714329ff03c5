"""The contracts of import-linter in `pyproject.toml` hold, no circle of imports exists, light imports stay light."""

from __future__ import annotations

import json
import subprocess
import sys

import networkx
import pytest
from importlinter import cli

from tests.source_tree import PACKAGES, ROOT, first_party_imports, modules

HEAVY = ("z3", "sapien", "torch", "openai", "pydantic", "pytorch_kinematics", "h5py", "av", "scipy", "matplotlib")


def test_the_contracts_hold(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    broken = cli.lint_imports(no_cache=True)
    assert not broken, capsys.readouterr().out


def test_modules_import_without_circles() -> None:
    known = modules()
    graph = networkx.DiGraph(
        (found.module, target)
        for name, path in known.items()
        for found in first_party_imports(name, path)
        # An import for type checkers only counts, too: it hides a circle.
        if (target := found.target if found.target in known else found.target.rpartition(".")[0]) != found.module
    )
    circles = [sorted(part) for part in networkx.strongly_connected_components(graph) if len(part) > 1]
    assert not circles, circles


def loaded_after(statement: str) -> set[str]:
    """Return the top-level modules that a fresh process has loaded after a statement."""
    code = f"{statement}\nimport json, sys\nprint(json.dumps(sorted({{m.split('.')[0] for m in sys.modules}})))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=600, check=True
    )
    return set(json.loads(done.stdout))


@pytest.mark.parametrize("package", PACKAGES)
def test_importing_a_package_loads_nothing_heavy(package: str) -> None:
    loaded = loaded_after(f"import {package}")
    assert package in loaded
    heavy = {"sapien", "torch", "pytorch_kinematics", "z3", "openai"} if package == "executor" else set(HEAVY)
    assert not loaded & heavy
    assert not loaded & set(PACKAGES[PACKAGES.index(package) + 1 :])
