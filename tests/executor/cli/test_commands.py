"""The sub-commands that move nothing, and what the front door loads."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

import oag
from tests.executor.cli.conftest import ROOT, Command, environment

DATA = ROOT / "tests" / "data"


def test_help_lists_every_sub_command(command: Command) -> None:
    answer = command("--help")
    assert answer.code == 0 and answer.err == ""
    for verb in ("run", "rollout", "verify", "recheck", "doctor", "scenes", "assets", "bddl"):
        assert f"• {verb} " in answer.out


def test_help_loads_nothing_that_takes_time() -> None:
    code = (
        "import sys\nfrom executor.cli.app import run\nrun(['--help'])\n"
        "names = {name.split('.')[0] for name in sys.modules}\n"
        "sys.exit(','.join(sorted(names & {'numpy', 'scipy', 'oag', 'llm', 'torch', 'sapien', 'av', 'PIL'})) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_verify_loads_neither_torch_nor_a_simulator() -> None:
    code = (
        "import sys\nfrom executor.cli.app import run\n"
        f"run(['verify', {str(DATA / 'T1.json')!r}])\n"
        "sys.exit(','.join(sorted(set(sys.modules) & {'torch', 'sapien', 'av', 'h5py'})) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_names_of_executor_come_when_they_are_used() -> None:
    code = (
        "import sys, executor\n"
        "assert not set(sys.modules) & {'torch', 'sapien', 'numpy', 'oag'}\n"
        "assert executor.rollout.__name__ == 'rollout' and callable(executor.rollout)\n"
        "assert not [name for name in executor.__all__ if getattr(executor, name) is None]\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", ["bddl", "oag", "llm"])
def test_a_foreign_package_in_the_folder_is_told_in_one_message(name: str, tmp_path: Path) -> None:
    (tmp_path / name).mkdir()
    (tmp_path / name / "__init__.py").write_text("")
    told = f"executor needs this project's own `{name}` package, but Python finds another one: {tmp_path / name}; "
    for words in (["-m", "executor", "scenes"], ["-c", "import executor; executor.load_scene('kitchen_t1')"]):
        done = subprocess.run([sys.executable, *words], cwd=tmp_path, env=environment(), capture_output=True, text=True)
        assert told in done.stderr and done.stdout == ""
        if words[0] == "-m":
            assert (
                done.returncode == 2 and done.stderr.startswith(f"scene2demo: {told}") and done.stderr.count("\n") == 1
            )
    (tmp_path / name / "__init__.py").unlink()
    done = subprocess.run([sys.executable, "-m", "executor", "scenes"], cwd=tmp_path, env=environment())
    assert done.returncode == 0


def test_verify_finds_the_scene_beside_the_task(command: Command) -> None:
    answer = command("verify", DATA / "T1.json", "--json")
    assert answer.code == 0
    assert answer.data["ok"] is True and answer.data["verdict"] == "PROVED"
    scene = oag.Scene.from_json(DATA / "T1_scene.json")
    assert answer.data["canonical"] == oag.canonical_digest(oag.Task.from_json(DATA / "T1.json"), scene)


def test_a_refuted_plan_is_a_failure_and_moves_nothing(command: Command, tmp_path: Path) -> None:
    task = json.loads((DATA / "T1.json").read_text())
    task["goal"] = "(ontop glass_0 refrigerator_0)"
    (tmp_path / "task.json").write_text(json.dumps(task))
    answer = command("verify", "task.json", "--scene", DATA / "T1_scene.json")
    assert answer.code == 1 and answer.out.startswith("REFUTED")
    answer = command("rollout", "task.json", "--scene", DATA / "T1_scene.json", "--json")
    assert answer.code == 1 and answer.data["verdict"] == "REFUTED" and "episodes" not in answer.data


def test_a_conditional_plan_moves_nothing_either(command: Command, tmp_path: Path) -> None:
    scene = json.loads((DATA / "T1_scene.json").read_text())
    scene = {**scene, "facts": ["(not (open refrigerator_0))"], "closed": []}
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    answer = command("rollout", DATA / "T1.json", "--scene", "scene.json", "--out", "r")
    assert answer.code == 1 and answer.out.startswith("CONDITIONAL")
    assert "conditional, not proved; nothing was moved" in answer.err and not (tmp_path / "r").exists()


def test_a_missing_flow_is_searched_and_where_none_exists_nothing_is_moved(command: Command, tmp_path: Path) -> None:
    task = json.loads((DATA / "T1.json").read_text())
    del task["sub_tasks"][2]["flow"]
    (tmp_path / "task.json").write_text(json.dumps(task))
    answer = command("verify", "task.json", "--scene", DATA / "T1_scene.json", "--json")
    assert answer.code == 0 and "flow/searched" in {found["code"] for found in answer.data["diagnostics"]}
    del task["sub_tasks"][0]
    (tmp_path / "task.json").write_text(json.dumps(task))
    answer = command("rollout", "task.json", "--scene", DATA / "T1_scene.json", "--json")
    assert answer.code == 1 and answer.data["diagnostics"][0]["code"] == "flow/no-flow"


def test_a_certificate_survives_its_file_and_a_forged_one_does_not(command: Command, tmp_path: Path) -> None:
    certificate = command("verify", DATA / "T1.json", "--json").data["certificate"]
    (tmp_path / "c.json").write_text(json.dumps(certificate))
    answer = command("recheck", "c.json")
    assert answer.code == 0 and answer.out.startswith("CONFIRMED  PROVED")
    (tmp_path / "c.json").write_text(json.dumps({**certificate, "verdict": "REFUTED"}))
    answer = command("recheck", "c.json", "--json")
    assert answer.code == 1 and answer.data["ok"] is False and answer.data["reason"]


def test_scenes_lists_what_comes_along(command: Command) -> None:
    assert "kitchen_t1" in command("scenes").out
    listed = command("scenes", "--json").data["scenes"]
    objects = {"refrigerator_0": "refrigerator", "table_0": "table", "glass_0": "water_glass"}
    assert {"name": "kitchen_t1", "objects": objects} in listed


@pytest.mark.slow
def test_doctor_prints_findings(command: Command) -> None:
    answer = command("doctor", "--json")
    assert answer.code in (0, 1)
    assert answer.data["ok"] is (answer.code == 0)
    assert {"topic", "status", "detail", "remedy"} <= set(answer.data["findings"][0])
