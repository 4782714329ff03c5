"""The API reference can be built from the docstrings and has every public name."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from tests.source_tree import PACKAGES, ROOT


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the reference as `make reference` does, and returns its folder."""
    folder = tmp_path_factory.mktemp("reference")
    line = [sys.executable, "-m", "pdoc", "-d", "google", "-o", str(folder), *PACKAGES]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_is_in_the_reference(pages: Path, package: str) -> None:
    page = (pages / f"{package}.html").read_text(encoding="utf-8")
    assert not [name for name in importlib.import_module(package).__all__ if f'id="{name}"' not in page]


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_function_and_class_says_what_it_is(package: str) -> None:
    module = importlib.import_module(package)
    things = {name: getattr(module, name) for name in module.__all__}
    own = {name: thing for name, thing in things.items() if callable(thing) and hasattr(thing, "__module__")}
    assert own
    assert not [name for name, thing in own.items() if thing.__module__.startswith(PACKAGES) and not thing.__doc__]
