"""What the package shows to the outside, and what importing it costs."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
from importlib.resources import files

import pytest

import bddl

MODULES = sorted(module.name for module in pkgutil.walk_packages(bddl.__path__, "bddl."))


def test_every_public_name_exists_and_is_listed_once() -> None:
    assert len(bddl.__all__) == len(set(bddl.__all__))
    assert [name for name in bddl.__all__ if not hasattr(bddl, name)] == []


def test_every_code_has_a_meaning() -> None:
    assert tuple(bddl.MEANINGS) == bddl.CODES
    assert all(meaning.endswith(".") for meaning in bddl.MEANINGS.values())


@pytest.mark.parametrize("module", MODULES)
def test_examples_in_docstrings_are_true(module: str) -> None:
    assert doctest.testmod(importlib.import_module(module)).failed == 0


@pytest.mark.parametrize("name", ["codes.toml", "dialects.toml", "py.typed", "vocabulary.toml"])
def test_data_files_lie_in_the_package(name: str) -> None:
    assert files("bddl").joinpath(name).is_file()
