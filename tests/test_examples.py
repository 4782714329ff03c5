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
MARKS = {
    "03": (pytest.mark.physics, pytest.mark.slow),
    "05": (pytest.mark.render, pytest.mark.slow),
    "06": (pytest.mark.physics, pytest.mark.slow),
    "07": (pytest.mark.physics, pytest.mark.slow),
    "08": (pytest.mark.physics, pytest.mark.slow),
    "12": (pytest.mark.physics, pytest.mark.slow),
}
# One for each thing that a user does.
TOPICS = ("verify", "plan", "rollout", "own_scene", "photograph", "demonstrations", "train", "evaluate")


def test_examples_are_numbered_and_show_what_users_do() -> None:
    assert [path.name[:2] for path in EXAMPLES] == [f"{number:02}" for number in range(1, len(EXAMPLES) + 1)]
    assert tuple(path.stem[3:] for path in EXAMPLES[: len(TOPICS)]) == TOPICS


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_explains_itself(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) < MOST_LINES
    page = ast.get_docstring(ast.parse(text))
    assert page is not None and f"python examples/{path.name}" in page


@pytest.fixture(scope="session")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return one folder for the results of all examples: later ones go on from earlier ones."""
    return tmp_path_factory.mktemp("examples")


@pytest.mark.parametrize("path", [pytest.param(p, marks=MARKS.get(p.name[:2], ()), id=p.stem) for p in EXAMPLES])
def test_an_example_runs(path: Path, results: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    takes_folder = "sys.argv" in path.read_text(encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(path), *([str(results)] if takes_folder else [])],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
