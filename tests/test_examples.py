"""Every example runs as its first lines say, is short, and begins with the text of its page."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))
MOST_LINES = 90
NEEDS_PHYSICS = ("06", "07")


def test_there_are_examples() -> None:
    assert len(EXAMPLES) >= 7


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_explains_itself(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) < MOST_LINES
    page = ast.get_docstring(ast.parse(text))
    assert page is not None and f"python examples/{path.name}" in page


@pytest.mark.parametrize(
    "path",
    [pytest.param(p, marks=pytest.mark.physics) if p.name.startswith(NEEDS_PHYSICS) else p for p in EXAMPLES],
    ids=lambda path: path.stem,
)
def test_an_example_runs(path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, str(path)], cwd=ROOT, env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
