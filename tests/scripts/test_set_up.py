"""The set-up runs again when what decides its outcome changes, and chooses the CPU build of PyTorch."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
import set_up
import torch_cpu


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "scripts").mkdir()
    (tmp_path / "scripts" / "a.py").write_text("one")
    (tmp_path / "pyproject.toml").write_text("two")
    (tmp_path / "constraints.txt").write_text("torch==2.13.0\nuv==0.13.8\n")
    monkeypatch.setattr(set_up, "ROOT", tmp_path)
    monkeypatch.setattr(set_up, "CONSTRAINTS", tmp_path / "constraints.txt")
    return tmp_path


@pytest.mark.parametrize("name", ["pyproject.toml", "constraints.txt", "scripts/a.py"])
def test_a_change_calls_for_another_set_up(checkout: Path, name: str) -> None:
    before = set_up.fingerprint()
    assert set_up.fingerprint() == before
    (checkout / name).write_text("changed")
    assert set_up.fingerprint() != before


def attempts(monkeypatch: pytest.MonkeyPatch, success_with: str) -> list[str]:
    """Let only commands that contain a word succeed; returns the list that they are noted in."""
    made: list[str] = []

    def succeeds(command: list[str]) -> bool:
        made.append(" ".join(command))
        return success_with in made[-1]

    monkeypatch.setattr(torch_cpu, "_succeeds", succeeds)
    monkeypatch.setattr("platform.system", lambda: "Linux")
    return made


def test_a_wheel_on_the_machine_is_enough(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(torch_cpu.INDEX_VARIABLE, raising=False)
    made = attempts(monkeypatch, "--no-index")
    told = torch_cpu.install_torch(Path("python"), checkout / "constraints.txt")
    assert "a wheel on this machine" in told
    assert len(made) == 1 and made[0].endswith("--no-index torch==2.13.0")


def test_the_users_index_comes_first(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(torch_cpu.INDEX_VARIABLE, "http://mirror.example/cpu")
    made = attempts(monkeypatch, "")
    assert torch_cpu.INDEX_VARIABLE in torch_cpu.install_torch(Path("python"), checkout / "constraints.txt")
    assert "--index-url http://mirror.example/cpu" in made[0]


def test_the_default_build_is_announced_with_its_size(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(torch_cpu.INDEX_VARIABLE, raising=False)
    made = attempts(monkeypatch, "uv==0.13.8")
    told = torch_cpu.install_torch(Path("python"), checkout / "constraints.txt")
    assert "about 3 GB" in told and torch_cpu.INDEX_VARIABLE in told
    assert any("--torch-backend cpu" in command for command in made)


def test_an_unpinned_package_is_refused(checkout: Path) -> None:
    (checkout / "constraints.txt").write_text("uv==0.13.8\n")
    with pytest.raises(ValueError, match="pins no version of torch"):
        torch_cpu.install_torch(Path("python"), checkout / "constraints.txt")


@pytest.fixture
def environment(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Stands in for all that the set-up runs; returns the list of the extras that were installed, a call each."""
    made: list[str] = []
    python = checkout / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text("")
    monkeypatch.setattr(set_up, "PYTHON", python)
    monkeypatch.setattr(set_up, "STAMP", checkout / ".venv" / "scene2demo-set-up")
    monkeypatch.setattr(set_up, "usable", lambda: True)
    monkeypatch.setattr(set_up, "install_torch", lambda *_: made.append("torch") or "torch comes from a test")
    monkeypatch.setattr(set_up, "install", lambda packages: made.append(packages[-1]))
    monkeypatch.setattr(set_up, "run", lambda command, what: None)
    return made


def test_the_demo_installs_no_more_than_it_needs_and_a_second_call_nothing(environment: list[str]) -> None:
    assert set_up.main(["demo"]) == set_up.main(["demo"]) == 0
    assert environment == [".[sim,data]"]


def test_a_later_level_adds_and_an_earlier_one_takes_nothing_away(environment: list[str], checkout: Path) -> None:
    assert [set_up.main([level]) for level in ("demo", "test", "demo", "all", "test")] == [0] * 5
    assert environment == [".[sim,data]", "torch", ".[all,dev]"]
    (checkout / "pyproject.toml").write_text("changed")
    assert set_up.main(["demo"]) == 0
    assert environment[3:] == ["torch", ".[all,dev]"]
    assert set_up.main(["test"]) == 0 and len(environment) == 5


def test_a_repair_goes_through_the_installed_level_again(environment: list[str]) -> None:
    set_up.main(["test"])
    set_up.STAMP.write_text(re.sub(r"^[^ ]*", "again", set_up.STAMP.read_text()))
    assert set_up.main(["demo"]) == 0
    assert environment == ["torch", ".[all,dev]"] * 2


@pytest.mark.parametrize("stamp", ["", "0123\n", "0123 other\n", "one two three"])
def test_an_unreadable_stamp_is_none(environment: list[str], stamp: str) -> None:
    set_up.STAMP.write_text(stamp)
    assert set_up.installed() == "" and not set_up.enough("demo")


def test_an_unknown_level_is_refused(environment: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert set_up.main(["dmeo"]) == 2
    assert "there is no level 'dmeo'; there are demo, all, test" in capsys.readouterr().out
    assert environment == []


def test_what_pip_is_at_is_told_with_sizes(
    checkout: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [
        "Collecting sapien",
        "  Downloading https://example.org/a/sapien-3.0.3-cp311-manylinux_x86_64.whl (50.1 MB)",
        "Requirement already satisfied: pip",
        "  Using cached scipy-1.16.0-cp311.whl.metadata (61 kB)",
        "Installing collected packages: sapien, scipy",
    ]
    monkeypatch.setattr(set_up, "pip", lambda *_: [sys.executable, "-c", f"print({chr(10).join(lines)!r})"])
    set_up.install(["x"])
    assert capsys.readouterr().out.splitlines() == [
        "[set-up]   1: sapien-3.0.3-cp311-manylinux_x86_64 (50.1 MB)",
        "[set-up]   writing 2 packages into .venv",
    ]
    monkeypatch.setattr(set_up, "pip", lambda *_: [sys.executable, "-c", "print('no room'); raise SystemExit(1)"])
    with pytest.raises(set_up.SetUpFailed, match="exit status 1"):
        set_up.install(["x"])
    assert "no room" in capsys.readouterr().out
