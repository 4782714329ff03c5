"""Which Vulkan driver is chosen, and what is said when there is none."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from executor.system import doctor, vulkan
from executor.system.vulkan import Device, Renderer

NO_DEVICE = ((), "no Vulkan driver is installed")


@pytest.fixture(autouse=True)
def bare_machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A machine without any driver: none in the environment, none beside it, none of the system."""
    for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    see(monkeypatch, NO_DEVICE)


def see(monkeypatch: pytest.MonkeyPatch, seen: tuple[tuple[Device, ...], str]) -> None:
    """Let the system's drivers offer these devices."""
    vulkan._system_renderer.cache_clear()
    vulkan._named_renderer.cache_clear()
    monkeypatch.setattr(vulkan, "probe_devices", lambda: seen)


def install_private(*, complete: bool = True) -> Path:
    """Lays out a private driver as the set-up does; returns its manifest for the Vulkan loader."""
    prefix = vulkan.private_prefix()
    (prefix / "lib").mkdir(parents=True)
    if complete:
        (prefix / "lvp_icd.json").write_text("{}")
    manifest = {"icd": "lvp_icd.json", "version": "25.0.7", "preload": []}
    (prefix / vulkan.MANIFEST_NAME).write_text(json.dumps(manifest))
    return prefix / "lvp_icd.json"


def test_without_any_driver_the_reason_and_a_remedy_are_given() -> None:
    renderer = vulkan.find_renderer()
    assert renderer.kind == "none" and not renderer
    assert renderer.why == "no Vulkan driver is installed"
    with pytest.raises(vulkan.RendererNotFound, match=r"driver is installed\. Run `make repair`") as raised:
        vulkan.activate()
    # Environments that step in processes of their own send it home.
    assert str(pickle.loads(pickle.dumps(raised.value))) == str(raised.value)


def test_an_old_lavapipe_will_not_do(monkeypatch: pytest.MonkeyPatch) -> None:
    see(monkeypatch, ((Device("llvmpipe", "cpu", "22.3.6"),), ""))
    renderer = vulkan.find_renderer()
    assert renderer.kind == "none"
    assert "22.3.6" in renderer.why and "24.3" in renderer.why


def test_a_graphics_card_comes_before_the_software_renderer(monkeypatch: pytest.MonkeyPatch) -> None:
    see(monkeypatch, ((Device("llvmpipe", "cpu", "25.0.7"), Device("card", "discrete", "535.54")), ""))
    assert vulkan.find_renderer() == Renderer("system", "card, driver 535.54")


def test_the_private_driver_comes_before_the_systems(monkeypatch: pytest.MonkeyPatch) -> None:
    see(monkeypatch, ((Device("llvmpipe", "cpu", "25.0.7"),), ""))
    install_private()
    renderer = vulkan.find_renderer()
    assert renderer.kind == "private" and "25.0.7" in renderer.why


def test_half_a_private_driver_is_none() -> None:
    install_private(complete=False)
    assert vulkan.find_renderer().kind == "none"


@pytest.mark.parametrize("variable", ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"])
def test_a_driver_named_in_the_environment_is_the_users_word(variable: str, monkeypatch: pytest.MonkeyPatch) -> None:
    install_private()
    see(monkeypatch, ((Device("llvmpipe", "cpu", "22.3.6"),), ""))
    monkeypatch.setenv(variable, "/etc/absent.json:/etc/mine.json")
    renderer = vulkan.find_renderer()
    assert renderer.kind == "system" and "/etc/mine.json" in renderer.why


@pytest.mark.parametrize("variable", ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"])
def test_named_drivers_without_a_device_are_refused_in_one_message(
    variable: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    install_private()
    present = tmp_path / "present.json"
    present.write_text("no manifest")
    for listed, why in (
        ("/no/a.json", "lists /no/a.json, and /no/a.json does not exist"),
        (f"/no/a.json:{present}:/no/b.json", "/no/a.json, /no/b.json do not exist"),
        (str(present), "and no driver is found there (no Vulkan driver is installed)"),
    ):
        monkeypatch.setenv(variable, listed)
        with pytest.raises(vulkan.RendererNotFound, match="Nothing here can draw pictures") as raised:
            vulkan.activate()
        assert f"{variable} lists" in str(raised.value) and why in str(raised.value)
        assert f"Unset {variable}" in str(raised.value)


def test_activation_reaches_child_processes_and_stays_private_there(monkeypatch: pytest.MonkeyPatch) -> None:
    icd = install_private()
    # Registered with monkeypatch first, so that what activate() writes is undone after the test.
    monkeypatch.setenv("VK_DRIVER_FILES", "")
    monkeypatch.setenv("VK_ICD_FILENAMES", "")
    first = vulkan.activate()
    code = "import os; print(os.environ['VK_DRIVER_FILES'])"
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert child.stdout.strip() == str(icd)
    assert vulkan.activate() == first and first.kind == "private"


@pytest.mark.parametrize(
    ("text", "numbers"), [("25.0.7-2~bpo12+1", (25, 0, 7)), ("24.3", (24, 3)), ("unknown", ()), ("", ())]
)
def test_versions_compare_by_their_leading_numbers(text: str, numbers: tuple[int, ...]) -> None:
    assert vulkan.version_tuple(text) == numbers


def test_the_probe_answers_without_a_loader() -> None:
    program = Path(vulkan.__file__).with_name("vulkan_probe.py")
    done = subprocess.run(
        [sys.executable, "-I", "-S", str(program), "libnosuchthing.so"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    answer = json.loads(done.stdout)
    assert answer["devices"] == [] and "libnosuchthing.so" in answer["problem"]


@pytest.mark.physics
def test_a_box_falls_to_the_ground() -> None:
    assert doctor.problem_with("physics") == ""
