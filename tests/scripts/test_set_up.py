"""The set-up runs again when what decides its outcome changes, and chooses the CPU build of PyTorch."""

from __future__ import annotations

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
    """Lets only commands that contain a word succeed; returns the list that they are noted in."""
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
