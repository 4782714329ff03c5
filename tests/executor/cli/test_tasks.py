"""`scene2demo tasks`: wishes as they are proved, geometry on request with answers that are kept, what can go wrong."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from executor.cli import app
from executor.rollouts import admitted
from executor.rollouts.feasibility import Feasibility
from oag import Task

KITCHEN = "kitchen_t4"


def tasks(capsys: pytest.CaptureFixture[str], *words: str | Path) -> tuple[int, str, str]:
    code = app.run(["tasks", *map(str, words)])
    printed = capsys.readouterr()
    return code, printed.out, printed.err


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the tasks whose feasibility is asked; every door is refused, and all else is feasible."""
    names: list[str] = []

    def feasible(graph: Any, *rest: object, **named: object) -> Feasibility:
        task: Task = graph.task
        names.append(task.name)
        return Feasibility(task, (), None, "", (), 0.1)

    monkeypatch.setattr(admitted, "feasible", feasible)
    return names


def test_wishes_are_listed_by_kind_with_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = tasks(capsys, KITCHEN)
    assert code == 0
    lines = out.splitlines()
    assert lines[0] == "open" and lines[1].split("  ")[1] == "open the cabinet"
    assert any(line.split()[-1] == "13" for line in lines if line.strip().startswith("all kinds"))


def test_a_list_as_json_has_goals_and_tasks(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = tasks(capsys, "kitchen_t2", "--kind", "pick", "stack", "--json")
    data = json.loads(out)
    assert code == data["exit_code"] == 0
    assert [one["kind"] for one in data["tasks"]] == ["pick", "pick", "stack", "stack"]
    assert all(one["goal"] and one["task"]["sub_tasks"] for one in data["tasks"])
    assert {one["wish"]: one["reason"]["code"] for one in data["refused"]}["pick up plate_0"] == "impossible"


def test_answers_are_kept_and_not_asked_again(
    capsys: pytest.CaptureFixture[str], asked: list[str], tmp_path: Path
) -> None:
    kept = tmp_path / "answers.jsonl"
    words = (KITCHEN, "--feasible", "--out", kept)
    assert tasks(capsys, *words, "--most", "3")[0] == 0 and len(asked) == 3
    # A line that was not written to its end is asked again.
    kept.write_text(kept.read_text()[:-20])
    code, out, _ = tasks(capsys, *words)
    assert code == 0 and len(asked) == 3 + 1 + 10
    assert out.count("feasible") >= 13
    assert tasks(capsys, *words)[0] == 0 and len(asked) == 14
    assert tasks(capsys, *words, "--seed", "1", "--most", "1")[0] == 0 and len(asked) == 15


def test_a_question_beyond_its_limit_has_no_answer(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("kitchen_t3", "--kind", "fill", "--feasible", "--limit-s", "0.001", "--json")
    code, out, _ = tasks(capsys, *words)
    (only,) = json.loads(out)["tasks"]
    assert code == 1 and only["feasible"] is None and "0.001 s" in only["reason"]


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("kitchen_t9",), "kitchen_t9"),
        ((KITCHEN, "--most", "0"), "--most"),
        ((KITCHEN, "--out", "a.jsonl"), "--out"),
        ((KITCHEN, "--kind", "juggle"), "juggle"),
    ],
)
def test_what_makes_no_sense_is_refused(capsys: pytest.CaptureFixture[str], words: tuple[str, ...], named: str) -> None:
    code, _, err = tasks(capsys, *words)
    assert code == 2 and named in err and "Traceback" not in err


def test_everything_of_a_scene_becomes_a_request(
    capsys: pytest.CaptureFixture[str], asked: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Any] = []

    def make(campaign: object, series: list[Any], *rest: object, **named: object) -> int:
        made.extend(series)
        return 0

    monkeypatch.setattr("executor.cli.commands.generate.make_missing", make)
    words = ["generate", "--all-tasks", KITCHEN, "--limit", "6", "--episodes", "2", "--out", str(tmp_path / "set")]
    assert app.run(words) == 0
    # One of each kind comes before the second of any.
    assert len({series.first.origin.query for series in made}) == 6 and len(asked) == 6
    assert made[0].first.origin.query == "open the cabinet" and made[0].episodes == 2
    assert "6 wishes are feasible" in capsys.readouterr().err


def test_nothing_that_is_feasible_is_an_answer_in_json_too(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nothing(*_: object, **__: object) -> Iterator[object]:
        return iter(())

    monkeypatch.setattr("llm.tasks", nothing)
    words = ["generate", "--all-tasks", KITCHEN, "--out", str(tmp_path / "set")]
    assert app.run([*words, "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["ok"] is False and told["exit_code"] == 1 and "feasible" in told["problem"]
    assert app.run(words) == 1 and not capsys.readouterr().out


def test_all_tasks_stands_alone(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = str(tmp_path / "set")
    assert app.run(["generate", "T1", "--all-tasks", KITCHEN, "--out", out]) == 2
    assert app.run(["generate", "T1", "--limit", "3", "--out", out]) == 2
    assert "--all-tasks as well" in capsys.readouterr().err
