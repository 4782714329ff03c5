"""The doctor reports what is there, names remedies, and never shows a key."""

from __future__ import annotations

import importlib.util
import json

import pytest

from executor.system import doctor, extras, vulkan
from executor.system.doctor import DoctorFinding
from executor.system.vulkan import Renderer


@pytest.fixture(autouse=True)
def simulator(monkeypatch: pytest.MonkeyPatch) -> None:
    """A simulator that works, and needs no seconds for it."""
    monkeypatch.setattr(doctor, "problem_with", lambda check: "")


def by_topic() -> dict[str, DoctorFinding]:
    return {finding.topic: finding for finding in doctor.examine()}


def test_every_extra_is_examined_and_all_is_plain_data() -> None:
    found = by_topic()
    assert {f"extra {name}" for name in extras.EXTRAS} <= set(found)
    assert json.loads(json.dumps([finding.to_json() for finding in found.values()]))


def test_a_key_is_named_and_its_value_never_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", "sk-very-secret")
    findings = doctor.examine()
    assert "OPENAI_API_KEY" in by_topic()["model"].detail
    assert "very-secret" not in repr(findings)


def test_without_a_key_nothing_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in doctor.MODEL_KEY_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    assert by_topic()["model"].status == "ok"


def test_a_missing_extra_comes_with_its_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "EXTRAS", {**extras.EXTRAS, "data": ("no-such-distribution-here",)})
    finding = by_topic()["extra data"]
    assert finding.status == "note" and "no-such-distribution-here" in finding.detail
    assert "pip install -e '.[data]'" in finding.remedy


def test_without_a_renderer_the_cameras_are_the_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    none = Renderer("none", "no Vulkan driver is installed", "Run something.")
    monkeypatch.setattr(vulkan, "find_renderer", lambda: none)
    finding = by_topic()["rendering"]
    assert (finding.status, finding.detail) == ("problem", "no Vulkan driver is installed")
    assert finding.remedy == "Run something."
    assert not doctor.healthy((finding,))


def test_a_simulator_that_fails_is_a_problem_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "installed_version", lambda name: "1.0")
    monkeypatch.setattr(vulkan, "find_renderer", lambda: Renderer("system", "a card"))
    monkeypatch.setattr(doctor, "problem_with", lambda check: f"{check} broke")
    found = by_topic()
    assert found["physics"].status == found["rendering"].status == "problem"
    assert "physics broke" in found["physics"].detail and "drawing broke" in found["rendering"].detail


def test_known_hazards_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    versions = {"mplib": "0.2.1", "numpy": "2.4.6", "bddl": "3.0"}
    monkeypatch.setattr(extras, "installed_version", versions.get)
    really = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: really("json") if name == "pinocchio" else really(name)
    )
    found = by_topic()
    assert "ends the process on numpy 2" in found["mplib"].detail
    assert found["pinocchio"].remedy == "pip uninstall pin"
    assert found["bddl"].status == "note" and "3.0" in found["bddl"].detail
