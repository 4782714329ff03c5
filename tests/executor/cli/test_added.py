"""A command that is added as one file is found, listed, run and suggested, as CONTRIBUTING.md says."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import executor.cli.commands
from executor.cli.app import commands, load_commands, run
from tests.source_tree import ROOT

MOST_LINES = 40


@pytest.fixture
def added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Yield the name of the page's command, whose file stands beside those of the package."""
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    found = re.search(r"^```python\n(\"\"\"`scene2demo category-count`.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert found is not None and len(found[1].splitlines()) <= MOST_LINES
    (tmp_path / "category_count.py").write_text(found[1], encoding="utf-8")
    monkeypatch.setattr(executor.cli.commands, "__path__", [*executor.cli.commands.__path__, str(tmp_path)])
    load_commands.cache_clear()
    yield "category-count"
    load_commands.cache_clear()


def test_the_page_s_command_runs(added: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([added, "--scene", "kitchen_t1"]) == 0
    assert "   1  table\n" in capsys.readouterr().out
    assert run([added, "--scene", "kitchen_t1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["counts"]["water_glass"] == 1
    assert run([added, "--scene", "kitchen_t0"]) == 2


def test_it_is_in_the_help_and_suggested(added: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert list(commands())[-1] == added
    assert run([added, "--help"]) == 0
    assert "Count the objects of a scene by category" in capsys.readouterr().out
    assert run(["category-cuont"]) == 2
    assert f"did you mean {added}?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("import no_such_library\n", "ModuleNotFoundError: No module named 'no_such_library'"),
        ("def execute(:\n", "SyntaxError"),
        ("x = 1\n", "AttributeError"),
    ],
)
def test_a_file_that_cannot_be_loaded_leaves_the_others_working(
    text: str, problem: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "broken_one.py").write_text(text, encoding="utf-8")
    monkeypatch.setattr(executor.cli.commands, "__path__", [*executor.cli.commands.__path__, str(tmp_path)])
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    load_commands.cache_clear()
    sys.modules.pop("executor.cli.commands.broken_one", None)
    try:
        assert run(["--help"]) == 0
        shown = capsys.readouterr()
        assert "bench photo" in shown.out and "broken-one" not in shown.out
        assert shown.err.startswith("scene2demo: the command file broken_one.py cannot be loaded")
        assert problem in shown.err and "Traceback" not in shown.err
        assert run(["broken-one", "--json"]) == 2
        assert problem in json.loads(capsys.readouterr().out)["error"]["message"]
    finally:
        sys.modules.pop("executor.cli.commands.broken_one", None)
        load_commands.cache_clear()
