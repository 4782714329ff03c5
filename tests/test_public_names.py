"""What the packages promise in `__all__` is there, and what the design calls stable is promised."""

from __future__ import annotations

import importlib
import importlib.util

import pytest

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
