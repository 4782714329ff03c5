"""`scene2demo plan`: proof and feasibility of a sentence, exit codes, and that nothing moves."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import oag
from executor.cli import app
from executor.records import Failure
from executor.scenes.library import load
from executor.scenes.placement import PlaceSpec, place
from executor.scenes.room import Room, against, stand
from executor.skills.control import Controller
from executor.skills.dry_run import DryController
from executor.system.files import write_json
from tests.executor.cli.conftest import environment

QUERY = "put the glass into the refrigerator"
GOLDEN = Path(__file__).parents[2] / "golden" / "plan_T1.txt"

Planned = tuple[int, str, str]


def plan(capsys: pytest.CaptureFixture[str], *words: str | Path) -> Planned:
    """Return the exit code, and what was printed on standard output and beside it."""
    code = app.run(["plan", *map(str, words)])
    told = capsys.readouterr()
    return code, told.out, told.err


def as_json(capsys: pytest.CaptureFixture[str], *words: str | Path) -> tuple[int, dict[str, Any]]:
    code, out, _ = plan(capsys, *words, "--json")
    return code, json.loads(out)


@pytest.fixture
def high_shelf(tmp_path: Path) -> Path:
    """A file of a room whose can stands higher than the arm reaches."""
    room = Room("a_room", "kitchen", np.random.default_rng(12000), depth_m=3.6, width_m=3.8)
    stand(room, room.draw("table_four_legs"), -0.8, 0.0)
    shelf = room.draw("shelf_open", extent_m={"z": 1.5})
    against(room, "north", shelf, 0.0)
    place(room, room.draw("can"), PlaceSpec(shelf.id, region="top"))
    return write_json(tmp_path / "room.json", room.scene().to_json())


def test_what_is_printed_of_a_plan_that_can_be_done(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = plan(capsys, QUERY, "--scene", "kitchen_t1")
    assert code == 0
    steps = ["loading the planner and the simulator", "reading the scene kitchen_t1", "planning, and proving the plan"]
    steps += ["note: glass_0 is scaled by 0.7", "going through the plan by geometry, subtask by subtask"]
    for line, step in zip(err.splitlines(), steps, strict=True):
        assert line.strip().startswith(step)
    if os.environ.get("REWRITE_GOLDEN") == "1":
        GOLDEN.write_text(out, encoding="utf-8")
    assert out == GOLDEN.read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_robot_does_not_move_and_nothing_is_written(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    follow = Controller.follow

    def moved(control: Controller, *given: Any, **more: Any) -> Failure | None:
        assert isinstance(control, DryController), "a robot of the physics moved"
        return follow(control, *given, **more)

    monkeypatch.setattr(Controller, "follow", moved)
    monkeypatch.chdir(tmp_path)
    code, told = as_json(capsys, QUERY, "--scene", "kitchen_t1")
    assert code == 0 and told["ok"] and told["verdict"] == "PROVED" and not list(tmp_path.iterdir())
    assert oag.recheck(told["certificate"], task=oag.Task.from_json(told["plan"]), scene=load("kitchen_t1"))
    parts = told["feasibility"]["subtasks"]
    assert [part["name"] for part in parts] == [part["task_activity_name"] for part in told["plan"]["sub_tasks"]]
    assert all(part["feasible"] and part["margin_deg"] > 0.0 for part in parts)
    assert parts[2]["region"].startswith("shelf") and told["feasibility"]["failure"] is None


@pytest.mark.slow
def test_what_the_arm_cannot_reach_ends_in_1_with_the_number(
    capsys: pytest.CaptureFixture[str], high_shelf: Path
) -> None:
    code, out, _ = plan(capsys, "put the can on the table", "--scene", high_shelf)
    assert code == 1 and out.startswith("PROVED")
    assert "INFEASIBLE  0 of 2 subtasks, by geometry" in out
    assert "✗ pick_up_can (NAVIGATE_TO_TARGET): " in out and "the hand stays " in out


@pytest.mark.slow
def test_a_run_of_it_is_refused_before_anything_moves(
    capsys: pytest.CaptureFixture[str], high_shelf: Path, tmp_path: Path
) -> None:
    words = ["run", "put the can on the table", "--scene", str(high_shelf), "--no-video", "--json", "--out"]
    assert app.run([*words, str(tmp_path / "refused")]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["outcome"] == "not-run" and told["rollout"] is None
    assert told["feasibility"]["failure"]["kind"] == "unreachable"
    assert "Why it was not run" in (tmp_path / "refused" / "report.html").read_text()
    assert app.run([*words, str(tmp_path / "tried"), "--anyway"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["outcome"] == "failed" and told["feasibility"] is None


def test_of_a_plan_that_is_not_proved_feasibility_is_not_asked(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    known = load("kitchen_t1").to_json()
    facts = ["(ontop glass_0 table_0)"]
    unsure = write_json(tmp_path / "unsure.json", {**known, "facts": facts, "closed": []})
    code, out, err = plan(capsys, QUERY, "--scene", unsure)
    assert code == 1 and out.startswith("CONDITIONAL") and "FEASIBLE" not in out
    assert "whether it is feasible was not asked" in err
    code, told = as_json(capsys, QUERY, "--scene", unsure)
    assert code == 1 and told["feasibility"] is None and told["diagnostics"]


@pytest.mark.slow
def test_a_goal_is_planned_for_as_a_sentence_is(capsys: pytest.CaptureFixture[str]) -> None:
    goal = "(exists (?r - refrigerator) (and (inside glass_0 ?r) (not (open ?r))))"
    code, told = as_json(capsys, "--goal", goal, "--scene", "kitchen_t1")
    assert code == 0 and told["ok"] and told["verdict"] == "PROVED" and told["goal"] == goal
    assert len(told["plan"]["sub_tasks"]) == len(told["feasibility"]["subtasks"]) == 4
    assert oag.recheck(told["certificate"], task=oag.Task.from_json(told["plan"]), scene=load("kitchen_t1"))
    code, out, err = plan(capsys, "--goal", "(not (open refrigerator_0))", "--scene", "kitchen_t1")
    assert code == 0 and out.startswith("PROVED") and "to do nothing" in err


def test_a_goal_without_a_plan_ends_in_1_with_the_reason(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--goal", "(ontop table_0 refrigerator_0)", "--scene", "kitchen_t1")
    code, out, _ = plan(capsys, *words)
    assert code == 1 and out.startswith("no plan (impossible): ") and "table_0 is furniture" in out
    code, told = as_json(capsys, *words)
    assert code == 1 and not told["ok"] and told["refusal"]["code"] == "impossible"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((QUERY, "--scene", "kitchn_t1"), "did you mean kitchen_t1"),
        (("put the piano into the refrigerator", "--scene", "kitchen_t1"), "piano"),
        ((QUERY,), "--scene"),
        (("--scene", "kitchen_t1"), "a sentence is missing"),
        ((QUERY, "--goal", "(open refrigerator_0)", "--scene", "kitchen_t1"), "a sentence and a goal are given"),
        (("--goal", "(open refrigerator_0", "--scene", "kitchen_t1"), "parenthesis is missing"),
        (("--goal", "(open refrigerator_9)", "--scene", "kitchen_t1"), "refrigerator_0"),
    ],
)
def test_bad_input_is_one_clear_message(
    words: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = plan(capsys, *words)
    assert code == 2 and not out and message in err and "Traceback" not in err


def test_what_is_being_done_is_told_before_anything_is_loaded() -> None:
    code = (
        "import sys\nfrom executor.cli import output\n"
        "def stop(what, quiet):\n    print(what, sorted({name.split('.')[0] for name in sys.modules} & HEAVY))\n"
        "    raise SystemExit\n"
        "HEAVY = {'numpy', 'scipy', 'oag', 'llm', 'sapien', 'torch'}\n"
        "output.counting = stop\n"
        f"from executor.cli.app import run\nrun(['plan', {QUERY!r}, '--scene', 'kitchen_t1'])"
    )
    done = subprocess.run([sys.executable, "-c", code], env=environment(), capture_output=True, text=True, check=True)
    assert done.stdout == "loading the planner and the simulator []\n", done.stderr
