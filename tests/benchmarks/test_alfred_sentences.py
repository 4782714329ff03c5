"""The measure of people's instructions: unique, sorted, halved, and judged by the expert's plan."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from benchmarks.alfred_sentences import instructions, judged, main

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


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--drawn", "5"], "is no clone of ALFRED"),
        (["--drawn", "0"], "expected a count of 1 or more"),
        (["--drawn", "5", "--without", "."], "it holds neither"),
        (["--drawn", "5", "--half", "tuning"], "--half is not for --drawn"),
        (["--drawn", "5", "--tests"], "not allowed with"),
        (["--without", "."], "--without is for --drawn alone"),
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
