"""The measure of people's instructions: unique, sorted, halved, and judged by the expert's plan."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import alfred_sentences
from benchmarks.alfred_sentences import drawn_instructions, instructions, judged, main

TASKS = [
    {
        "task_type": "pick_two_obj_and_place",
        "action_sequence": "1. GotoLocation(sidetable), 2. PickupObject(keychain), 3. GotoLocation(sofa), "
        "4. PutObject(keychain,sofa), 5. GotoLocation(sidetable), 6. PickupObject(keychain), 7. GotoLocation(sofa), "
        "8. PutObject(keychain,sofa)",
        "original": ["Lay two sets of keys on the couch.", "lay two sets of  keys on the couch", "Juggle the keys"],
    },
    {
        "task_type": "pick_and_place_simple",
        "action_sequence": "GotoLocation(countertop), PickupObject(saltshaker), PutObject(saltshaker,drawer)",
        "original": ["Store the salt in the drawer!", "Store the salt on the fridge", "Lay the salt on the burner"],
    },
    {"task_type": "look_at_obj_in_light", "action_sequence": "", "original": ["Look at it"]},
]


def test_instructions_are_unique_sorted_and_judged_by_the_experts_plan(tmp_path: Path) -> None:
    (tmp_path / "refined_valid_seen_commands.json").write_text(json.dumps(TASKS), encoding="utf-8")
    found = instructions(tmp_path, ["simple", "two"])
    assert [(one.text, judged(one)[0]) for one in found] == [
        ("juggle the keys", "unknown-action"),
        ("lay the salt on the burner", "other"),
        ("lay two sets of keys on the couch", "understood"),
        ("store the salt in the drawer", "understood"),
        ("store the salt on the fridge", "affordance"),
    ]
    assert [len(found[2].scene.facts), found[2].moves] == [3, (("key_chain", "sofa"),) * 2]


def test_draws_share_no_demonstration_and_no_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    params = {"object_target": "SaltShaker", "mrecep_target": "", "parent_target": "Drawer"}
    told = [f"Store the {word} salt in the drawer" for word in ("big", "small", "red", "blue", "tall", "short")]
    for number, text in enumerate([*told, told[0].upper(), "Lay the salt aside!"]):
        folder = tmp_path / f"data/json_2.1.0/pick_and_place_simple-{number}/trial/pp"
        folder.mkdir(parents=True)
        annotation = {
            "split": "train", "ann": {"repeat_idx": 0}, "turk_annotations": {"anns": [{"task_desc": text}]},
            "pddl_params": params, "task_type": "pick_and_place_simple",
        }  # fmt: skip
        (folder / "ann_0.json").write_text(json.dumps(annotation), encoding="utf-8")
    (tmp_path / "refined_valid_seen_commands.json").write_text(
        json.dumps([{**TASKS[1], "original": ["lay the salt aside"]}]), encoding="utf-8"
    )
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@example.org", "-C", str(tmp_path)]
    for command in (["init", "-q"], ["add", "data"], ["commit", "-qm", "annotations"]):
        subprocess.run([*git, *command], check=True)
    monkeypatch.setattr(alfred_sentences, "_ANNOTATIONS", "HEAD")
    draws = [[one.text for one in drawn_instructions(tmp_path, 2, ["simple"], [tmp_path], draw)] for draw in (1, 2, 3)]
    assert [len(draw) for draw in draws] == [2, 2, 2] and {text for draw in draws for text in draw} == {
        text.lower() for text in told
    }
    assert drawn_instructions(tmp_path, 2, ["simple"], [tmp_path], 4) == []


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--drawn", "5"], "is no clone of ALFRED"),
        (["--drawn", "0"], "expected a count of 1 or more"),
        (["--drawn", "5", "--without", "."], "it holds neither"),
        (["--drawn", "5", "--half", "tuning"], "--half is not for --drawn"),
        (["--drawn", "5", "--tests"], "not allowed with"),
        (["--without", "."], "--without is for --drawn alone"),
        (["--draw", "2"], "--draw is for --drawn alone"),
        (["--drawn", "5", "--draw", "0"], "expected the number of a draw"),
        (["--tests"], "holds not the files"),
    ],
)
def test_a_wrong_call_ends_in_one_message(
    options: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["alfred_sentences", str(tmp_path), *options])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2 and said in capsys.readouterr().err
