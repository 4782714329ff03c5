"""`scene2demo verify` shows fixes, and writes the task with one of them applied."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.executor.cli.conftest import Command

DATA = Path(__file__).resolve().parents[2] / "data"
SCENE = DATA / "T1_scene.json"
BROKEN = DATA / "invalid" / "dropped_converge.json"


def test_fixes_are_shown_and_the_first_is_written(command: Command, tmp_path: Path) -> None:
    answer = command("verify", BROKEN, "--scene", SCENE, "--out", "new.json")
    assert answer.code == 0 and answer.out.startswith("REFUTED")
    assert "fix     (1) insert CONVERGE in T4 before step 3 GRASP   [checked: all obligations hold]" in answer.out
    assert "written to new.json: insert CONVERGE in T4" in answer.err
    repaired = json.loads((tmp_path / "new.json").read_text(encoding="utf-8"))
    assert repaired["sub_tasks"][3]["flow"][:4] == [17, 1, 2, 3]
    assert command("verify", "new.json", "--scene", SCENE).code == 0


def test_another_fix_is_chosen_by_its_number(command: Command, tmp_path: Path) -> None:
    assert command("verify", BROKEN, "--scene", SCENE, "--apply", 2, "--out", "new.json", "--json").code == 0
    flow = json.loads((tmp_path / "new.json").read_text(encoding="utf-8"))["sub_tasks"][3]["flow"]
    assert flow == [17, 1, 2, 3, {"19": None}, 5, 6]


def test_a_file_is_replaced_only_when_asked(command: Command, tmp_path: Path) -> None:
    (tmp_path / "new.json").write_text("mine", encoding="utf-8")
    answer = command("verify", BROKEN, "--scene", SCENE, "--out", "new.json")
    assert answer.code == 2 and "--force" in answer.err
    assert (tmp_path / "new.json").read_text(encoding="utf-8") == "mine"
    assert command("verify", BROKEN, "--scene", SCENE, "--out", "new.json", "--force").code == 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--apply", 9, "--out", "new.json"], "expected a number from 1 to 2"),
        (["--apply", 0, "--out", "new.json"], "expected a number from 1 to 2"),
        (["--apply", 1], "expected --out with the file that the repaired task goes to"),
    ],
)
def test_wrong_choices_are_misuse(command: Command, tmp_path: Path, arguments: list[str | int], said: str) -> None:
    answer = command("verify", BROKEN, "--scene", SCENE, *map(str, arguments))
    assert answer.code == 2 and said in answer.err
    assert not (tmp_path / "new.json").exists()


def test_a_proved_plan_is_written_with_its_searched_flows(command: Command, tmp_path: Path) -> None:
    task = json.loads((DATA / "T1.json").read_text(encoding="utf-8"))
    del task["sub_tasks"][1]["flow"]
    (tmp_path / "task.json").write_text(json.dumps(task), encoding="utf-8")
    answer = command("verify", "task.json", "--scene", SCENE, "--out", "deep/new.json")
    assert answer.code == 0 and "the task as it was verified, 1 of its flows searched" in answer.err
    written = json.loads((tmp_path / "deep" / "new.json").read_text(encoding="utf-8"))
    assert written["sub_tasks"][1]["flow"][:4] == [17, 1, 2, 3]
    answer = command("verify", DATA / "T1.json", "--out", "same.json")
    assert answer.code == 0 and "unchanged" in answer.err


def test_a_proved_plan_has_no_fix_to_apply(command: Command, tmp_path: Path) -> None:
    answer = command("verify", DATA / "T1.json", "--out", "new.json", "--apply", "7")
    assert answer.code == 2 and "the plan is PROVED, so it has no fixes" in answer.err
    assert not (tmp_path / "new.json").exists()


def test_the_certificate_is_written_and_rechecked(command: Command, tmp_path: Path) -> None:
    assert command("verify", DATA / "T1.json", "--certificate", "c.json").code == 0
    assert command("recheck", "c.json").code == 0
    again = command("verify", DATA / "T1.json", "--certificate", "c.json")
    assert again.code == 2 and "--certificate" in again.err and "--force" in again.err
    refuted = command("verify", BROKEN, "--scene", SCENE, "--certificate", "refuted.json")
    assert refuted.code == 1 and command("recheck", "refuted.json").code == 0
    broken = DATA / "invalid" / "missing_parenthesis.json"
    answer = command("verify", broken, "--scene", SCENE, "--certificate", "m.json")
    assert answer.code == 1 and "m.json is not written: there is no certificate" in answer.err
    assert not (tmp_path / "m.json").exists()


def test_what_verify_prints_can_be_rechecked(command: Command, tmp_path: Path) -> None:
    (tmp_path / "r.json").write_text(command("verify", DATA / "T1.json", "--json").out, encoding="utf-8")
    answer = command("recheck", "r.json")
    assert answer.code == 0 and answer.out.startswith("CONFIRMED  PROVED")
    (tmp_path / "r.json").write_text(
        command("verify", DATA / "invalid" / "missing_parenthesis.json", "--scene", SCENE, "--json").out,
        encoding="utf-8",
    )
    answer = command("recheck", "r.json")
    assert answer.code == 1 and "its plan is not well formed" in answer.out
    (tmp_path / "o.json").write_text("{}", encoding="utf-8")
    answer = command("recheck", "o.json")
    assert answer.code == 2 and "verify --certificate FILE" in answer.err


def test_a_stated_fact_is_left_to_the_person(command: Command, tmp_path: Path) -> None:
    scene = json.loads(SCENE.read_text(encoding="utf-8"))
    (tmp_path / "scene.json").write_text(json.dumps({**scene, "facts": []}), encoding="utf-8")
    shown = command("verify", DATA / "T1.json", "--scene", "scene.json", "--json").data["fixes"]
    number = next(index for index, fix in enumerate(shown, 1) if fix["assumption"])
    answer = command("verify", DATA / "T1.json", "--scene", "scene.json", "--apply", str(number), "--out", "new.json")
    assert answer.code == 1 and "add it to the scene's file if it is so" in answer.err
    assert not (tmp_path / "new.json").exists()


def test_a_sentence_with_another_goal_is_warned_of(command: Command, tmp_path: Path) -> None:
    task = json.loads((DATA / "T1.json").read_text(encoding="utf-8"))
    task["goal"] = "(not (open refrigerator_0))"
    (tmp_path / "task.json").write_text(json.dumps(task), encoding="utf-8")
    answer = command("verify", "task.json", "--scene", SCENE)
    assert answer.code == 0 and answer.out.startswith("PROVED")
    for code in ("answer/other-reading (warning)", "goal/holds-at-start (warning)", "goal/omits-effect (note)"):
        assert code in answer.out
    found = command("verify", "task.json", "--scene", SCENE, "--json").data["diagnostics"]
    assert [entry["severity"] for entry in found] == sorted((e["severity"] for e in found), reverse=True)
    assert "answer/other-reading" in {entry["code"] for entry in found}
