"""A command that is added as one file is found, listed, run and suggested, as CONTRIBUTING.md says."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import executor.cli.commands
from executor.cli.app import commands, run
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
    commands.cache_clear()
    yield "category-count"
    commands.cache_clear()


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
