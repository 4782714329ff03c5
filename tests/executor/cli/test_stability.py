"""`scene2demo stability`: forms of a sentence's plans, exit codes, JSON and the picture; and the notes of `verify`."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

import llm
import oag
from executor.cli import app
from executor.system.files import write_json
from tests.executor.cli.conftest import ROOT

QUERY = ["put the glass into the refrigerator", "--scene", "kitchen_t1"]
DATA = ROOT / "tests" / "data"
Typed = tuple[int, str, str]


def typed(capsys: pytest.CaptureFixture[str], *words: str | Path) -> Typed:
    code = app.run([*map(str, words)])
    told = capsys.readouterr()
    return code, told.out, told.err


def test_one_form_is_printed_drawn_and_ends_well(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    picture = tmp_path / "forms.svg"
    code, out, err = typed(capsys, "stability", *QUERY, "-n", "7", "--out", picture)
    assert code == 0 and out.startswith("STABLE  ") and "6 of 6 later runs" in out and "decomposing" in err
    assert "7 PROVED" in out and ET.parse(picture).getroot().tag.endswith("svg")
    code, _, err = typed(capsys, "stability", *QUERY, "-n", "2", "--out", picture)
    assert code == 2 and "--force" in err


def test_json_has_the_counts_and_other_forms_end_with_one(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code, out, _ = typed(capsys, "stability", *QUERY, "--runs", "3", "--perturb", "none", "--json")
    data: dict[str, Any] = json.loads(out)
    assert code == 0 and data["ok"] and data["by_change"] == {"none": [2, 2]} and data["subtasks"] == {"4": 3}
    plain = llm.propose

    def hasty(query: str, scene: oag.Scene) -> llm.Proposal:
        if next(iter(scene.objects)) != "refrigerator_0":
            raise llm.QueryError("ambiguous-reading", query, "it is hasty")
        return plain(query, scene)

    monkeypatch.setattr(llm, "propose", hasty)
    first = next(iter(__import__("executor").load_scene("kitchen_t1").objects))
    assert first == "refrigerator_0"
    code, out, _ = typed(capsys, "stability", *QUERY, "-n", "9", "--perturb", "order", "--json")
    data = json.loads(out)
    assert code == 1 and not data["ok"]
    assert [form["outcome"] for form in data["forms"] if form["subtasks"] is None] == ["QueryError ambiguous-reading"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--perturb", "oder"], "did you mean order"),
        (["--runs", "0"], "--runs 0: expected at least 1"),
        (["--record", "x.jsonl"], "--model with it"),
        (["--model", "replay:nothing.jsonl"], "nothing.jsonl"),
    ],
)
def test_bad_options_are_one_message(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = typed(capsys, "stability", *QUERY, *words)
    assert code == 2 and said in err and "Traceback" not in err


def test_a_sentence_that_is_refused_is_refused_as_in_plan(capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("plan", "stability"):
        code, _, err = typed(capsys, command, "wipe the ceiling", "--scene", "kitchen_t1")
        assert code == 2 and "ceiling" in err


def codes(capsys: pytest.CaptureFixture[str], file: Path, **changes: object) -> list[str]:
    task = json.loads((DATA / "T1.json").read_text(encoding="utf-8")) | changes
    scene = str(DATA / "T1_scene.json")
    code, out, _ = typed(capsys, "verify", write_json(file, task), "--scene", scene, "--json")
    assert code == 0
    return [found["code"] for found in json.loads(out)["diagnostics"]]


def test_verify_notes_a_goal_that_holds_at_the_start_or_forgets(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file, silent = tmp_path / "task.json", {"task_activity_name": "task", "task_detail_message": ""}
    shut = "(not (open refrigerator_0))"
    assert not {"goal/holds-at-start", "answer/other-reading"} & set(codes(capsys, file))
    assert "goal/holds-at-start" in codes(capsys, file, goal=shut, **silent)
    assert "answer/other-reading" not in codes(capsys, file, goal=shut, **silent)
    assert "answer/other-reading" in codes(capsys, file, goal=shut, query=QUERY[0], **silent)
    assert "answer/other-reading" in codes(
        capsys,
        file,
        goal="(inside glass_0 refrigerator_0)",
        query=("put the glass into the refrigerator and close it"),
        **silent,
    )
    strange = {**silent, "task_detail_message": "May glass_0 be stowed for the night."}
    assert "answer/forgotten-object" in codes(capsys, file, goal=shut, **strange)
