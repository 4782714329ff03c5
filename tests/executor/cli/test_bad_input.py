"""Bad input ends with exit code 2 and one clear message, never with a traceback; with --json it is one object."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from executor.scenes import library
from tests.executor.cli.conftest import ROOT, Command

T1 = ROOT / "tests" / "data" / "T1.json"
QUERY = "put the glass into the refrigerator"


def test_an_unknown_scene_gets_near_names(command: Command) -> None:
    answer = command("run", QUERY, "--scene", "kitchn_t1", "--out", "r")
    assert answer.code == 2 and answer.out == ""
    assert "there is no scene 'kitchn_t1'; did you mean kitchen_t1" in answer.err


def test_a_missing_scene_file_is_named(command: Command, tmp_path: Path) -> None:
    answer = command("run", QUERY, "--scene", "my/scene.json", "--out", "r")
    assert answer.code == 2
    assert "scene my/scene.json: cannot be read: No such file or directory" in answer.err
    assert not (tmp_path / "r").exists()


@pytest.mark.parametrize("verb", ["verify", "rollout"])
def test_malformed_json_has_line_and_column(command: Command, tmp_path: Path, verb: str) -> None:
    (tmp_path / "task.json").write_text('{"sub_tasks": [\n  {"target": }\n]}')
    answer = command(verb, "task.json", "--scene", "kitchen_t1")
    assert answer.code == 2
    assert "line 2, column 14" in answer.err


def test_a_missing_field_has_its_place(command: Command, tmp_path: Path) -> None:
    (tmp_path / "task.json").write_text(json.dumps({"sub_tasks": [{"target": "glass_0", "goal": "(open x)"}]}))
    answer = command("verify", "task.json", "--scene", "kitchen_t1")
    assert answer.code == 2
    assert "sub_tasks[0]" in answer.err and "'init'" in answer.err


def test_a_query_about_what_is_not_there_gets_suggestions(command: Command) -> None:
    answer = command("run", "put the unicorn into the refrigerator", "--scene", "kitchen_t1", "--out", "r")
    assert answer.code == 2
    assert "unicorn" in answer.err and "glass_0" in answer.err


def test_what_no_scaling_brings_into_the_gripper_is_refused(command: Command, tmp_path: Path) -> None:
    scene = library.load("kitchen_t1").to_json()
    objects = scene["objects"]
    assert isinstance(objects, dict)
    objects["glass_0"]["bbox_extent"] = [0.23, 0.23, 0.23]
    objects["glass_0"]["position"][2] = 0.715
    (tmp_path / "big.json").write_text(json.dumps(scene))
    answer = command("run", QUERY, "--scene", "big.json", "--out", "r")
    assert answer.code == 2 and not (tmp_path / "r").exists()
    assert "glass_0 is 0.230 m wide" in answer.err and "nothing is scaled by less than 0.6" in answer.err
    task = json.loads(T1.read_text()) | {"scales": {"glass_0": 0.01}}
    (tmp_path / "task.json").write_text(json.dumps(task))
    answer = command("rollout", "task.json", "--scene", "big.json")
    assert answer.code == 1 and "task/size  scales" in answer.out and "nothing was moved" in answer.err


def test_results_are_not_overwritten(command: Command, tmp_path: Path) -> None:
    (tmp_path / "r").mkdir()
    (tmp_path / "r" / "rollout.json").write_text("precious")
    answer = command("run", QUERY, "--scene", "kitchen_t1", "--out", "r")
    assert answer.code == 2
    assert "already has results (rollout.json)" in answer.err and "--force" in answer.err
    assert (tmp_path / "r" / "rollout.json").read_text() == "precious"


def test_an_output_folder_that_is_a_file_is_refused(command: Command, tmp_path: Path) -> None:
    (tmp_path / "r").write_text("a file")
    answer = command("run", QUERY, "--scene", "kitchen_t1", "--out", "r")
    assert answer.code == 2
    assert "output folder r cannot be used" in answer.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--seed", "-1"], "--seed -1: expected a whole number from 0"),
        (["--record-hz", "0"], "--record-hz 0.0: expected a rate from 1 to 125"),
        (["--size", "33", "33"], "pictures of 33 x 33 pixels are not possible"),
        (["--plain", "--no-video"], "--plain is given: expected no --no-video"),
    ],
)
def test_impossible_options_are_refused(command: Command, arguments: list[str], message: str) -> None:
    answer = command("run", QUERY, "--scene", "kitchen_t1", "--out", "r", *arguments)
    assert answer.code == 2 and message in answer.err


def test_errors_are_one_json_object_when_asked(command: Command) -> None:
    answer = command("run", QUERY, "--scene", "kitchn_t1", "--out", "r", "--json")
    assert answer.code == 2 and answer.err == ""
    assert answer.data["ok"] is False and answer.data["exit_code"] == 2
    assert answer.data["error"]["kind"] == "SceneNotFound"
    assert "did you mean kitchen_t1" in answer.data["error"]["message"]


def test_a_look_of_no_pictures_is_refused(command: Command) -> None:
    answer = command("generate", "T1", "--out", "g", "--plain")
    assert answer.code == 2 and "--plain is given: expected --views with it" in answer.err


@pytest.mark.parametrize("arguments", [["run"], ["fly"], [], ["verify"], ["run", QUERY, "--sceen", "kitchen_t1"]])
def test_wrong_command_lines_are_misuse(command: Command, arguments: list[str]) -> None:
    answer = command(*arguments)
    assert answer.code == 2 and answer.out == "" and answer.err
    assert command(*arguments, "--json").data["error"]["kind"] == "usage"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not valid JSON"),
        ("[]", "is no certificate"),
        pytest.param("[" * 100_000, "is not valid JSON", id="deep"),
        pytest.param("[" + "1" * 5000 + "]", "is not valid JSON", id="digits"),
        (None, "No such file or directory"),
    ],
)
def test_certificates_that_are_none(command: Command, tmp_path: Path, content: str | None, message: str) -> None:
    if content is not None:
        (tmp_path / "c.json").write_text(content)
    answer = command("recheck", "c.json")
    assert answer.code == 2 and message in answer.err
    assert answer.out == "" and "Traceback" not in answer.err


@pytest.mark.parametrize("episodes", ["0", "-1", "99999999999"])
def test_an_impossible_number_of_episodes_is_not_blamed_on_the_seed(command: Command, episodes: str) -> None:
    answer = command("rollout", str(T1), "--scene", "kitchen_t1", "--episodes", episodes)
    assert answer.code == 2
    assert f"--episodes {episodes}: expected a whole number from 1 to 1000000" in answer.err
    assert "--seed" not in answer.err


PROFILES = ("run", QUERY, "--scene", "kitchen_t1", "--out", "r", "--model", "lab:m")
SETTINGS = ("train", "deep.toml", "--data", "d", "--out", "p")
PLAN = ("generate", "deep.yaml", "--out", "g")


@pytest.mark.parametrize("depth", [pytest.param(300, marks=pytest.mark.slow), 100_000])
@pytest.mark.parametrize(
    ("head", "opening", "closing", "tail", "words"),
    [
        pytest.param("a = ", "[", "]", "", PROFILES, id="lists in profiles"),
        pytest.param("a = ", "{b=", "}", "", PROFILES, id="tables in profiles"),
        pytest.param("[lab]\nextra_body = {b=", "[", "]", "}", PROFILES, id="lists in a setting"),
        pytest.param("a = ", "[", "]", "", SETTINGS, id="lists in settings"),
        pytest.param("[network]\nhead = ", "{b=", "}", "", SETTINGS, id="tables in settings"),
        pytest.param("sources: ", "[", "]", "", PLAN, id="lists in a plan"),
        pytest.param("sources: ", "{a: ", "}", "", PLAN, id="maps in a plan"),
    ],
)
def test_files_nested_without_end_end_in_one_message(
    command: Command,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    head: str,
    opening: str,
    closing: str,
    tail: str,
    words: tuple[str, ...],
    depth: int,
) -> None:
    (tmp_path / "d").mkdir()  # What is missing is refused before a file is read.
    name = "deep.yaml" if words is PLAN else "deep.toml"
    # The inmost value; YAML's parser takes seconds for what it does not refuse.
    depth = min(depth, 20_000) if words is PLAN else depth
    (tmp_path / name).write_text(f"{head}{opening * depth}1{closing * depth}{tail}\n")
    monkeypatch.setenv("SCENE2DEMO_PROFILES", str(tmp_path / name) if words is PROFILES else "")
    answer = command(*words)
    assert answer.code == 2 and answer.out == "", answer.err
    assert "RecursionError" not in answer.err and "unexpected" not in answer.err
    # What a setting may hold is no mistake before it is too deep; then it is the model that is not there.
    assert len(answer.err.splitlines()) == 1 and (name in answer.err or "no profile for 'm'" in answer.err)


@pytest.mark.parametrize(
    "words",
    [
        ("verify", "large.json", "--scene", "kitchen_t1"),
        ("verify", T1, "--scene", "large.json"),
        ("recheck", "large.json"),
        ("bddl", "check", "large.bddl"),
        ("train", "large.toml", "--data", "d", "--out", "p"),
        ("generate", "large.yaml", "--out", "g"),
    ],
    ids=str,
)
def test_an_input_that_is_too_large_is_no_full_disk(command: Command, tmp_path: Path, words: tuple[str, ...]) -> None:
    (tmp_path / "d").mkdir()
    for ending in ("json", "bddl", "toml", "yaml"):
        (tmp_path / f"large.{ending}").write_text(" " * 8_000_001)
    answer = command(*words)
    assert answer.code == 2 and "larger than 8 MB" in answer.err and "room" not in answer.err
    assert len(answer.err.splitlines()) == 1
