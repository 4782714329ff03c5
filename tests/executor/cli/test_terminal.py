"""What reaches the terminal: nobody else's escape sequences, and no complaint where nobody reads."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from rich.live import Live
from rich.table import Table

from executor.cli import output
from executor.cli.app import run
from executor.cli.execution import RolloutProgress
from executor.records import Event
from tests.executor.cli.conftest import ROOT, environment

RED, CSI, TURNED = "\x1b[31m", "\x9b31m", "\u202e"
STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    """Go into an empty folder, and gives what commands print there."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    return capsys


def scene(tmp_path: Path, name: str) -> Path:
    """Write a scene whose object and names have some text in them."""
    content = json.loads((ROOT / "tests" / "data" / "T1_scene.json").read_text())
    thing = next(iter(content["objects"].values()))
    content |= {"name": name, "objects": {**content["objects"], f"{name}_0": {**thing, "model": name}}}
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize("sign", [RED, CSI, TURNED], ids=ascii)
def test_names_in_a_scene_do_not_steer_the_terminal(
    here: pytest.CaptureFixture[str], tmp_path: Path, sign: str
) -> None:
    path = str(scene(tmp_path, f"cup{sign}"))
    for words in (["scenes", path], ["verify", str(ROOT / "tests" / "data" / "T1.json"), "--scene", path]):
        run(words)
        said = here.readouterr()
        assert said.out + said.err and not STEERING.search(said.out + said.err), said


@pytest.mark.parametrize("sign", [RED, CSI, TURNED], ids=ascii)
def test_json_says_the_same_with_escapes(capsys: pytest.CaptureFixture[str], sign: str) -> None:
    output.print_json({f"a{sign}": [f"\n{sign}\ud800"]})
    shown = capsys.readouterr().out
    assert not STEERING.search(shown)
    assert json.loads(shown) == {f"a{sign}": [f"\n{sign}\ud800"]}


@pytest.mark.parametrize(
    "words",
    [
        ["run", "open the door", "--scene", f"kitchen{RED}", "--out", "r"],
        ["run", "open the door", "--scene", "kitchen_t1", "--out", "r", "--model", f"openai:{RED}"],
        ["run", "open the door", "--scene", "kitchen_t1", "--out", "r", "--model", f"{RED}:m"],
        ["run", "open the door", "--scene", "kitchen_t1", "--out", "r", "--model", f"replay:{RED}"],
        ["run", f"open the {RED}door", "--scene", "kitchen_t1", "--out", "r"],
        ["run", "open the door", "--scene", "kitchen_t1", "--out", "r", "--seed", RED],
        ["run", "open the door", f"--{RED}", "--out", "r"],
        [f"fly{RED}"],
        ["verify", f"{RED}.json"],
        ["bddl", "check", f"{RED}.bddl"],
        ["bench", "replay", "b", f"T1{RED}", "--out", "r"],
        ["bench", f"T1{RED}", "--out", "b"],
    ],
    ids=lambda words: ascii(" ".join(words))[-30:],
)
def test_nothing_that_is_typed_comes_back_as_it_was(here: pytest.CaptureFixture[str], words: list[str]) -> None:
    for more in ([], ["--json"]):
        assert run([*words, *more]) == 2
        said = here.readouterr()
        assert said.out or said.err
        assert not STEERING.search(said.out + said.err), said


def test_names_in_a_benchmark_do_not_steer_the_terminal(here: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    units = tmp_path / "b" / "units"
    units.mkdir(parents=True)
    for number in range(2):
        (units / f"T1{RED}_{number}-01234567.json").write_text("{}")
    (tmp_path / "b" / "bench.json").write_text('{"series": []}')
    assert run(["bench", "replay", "b", "T1", "--out", "r"]) == 2
    said = here.readouterr().err
    assert "T1␛[31m_0" in said and not STEERING.search(said)


def test_the_program_may_still_use_colours_and_moving_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("NO_COLOR", "COLORTERM"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    console = output._Terminal(force_terminal=True, color_system="standard", width=60, highlight=False)
    table = Table("a")
    table.add_row(f"b{RED}")
    with console.capture() as capture:
        console.print(f"said{RED}", style="red", markup=False)
        with Live(table, console=console, refresh_per_second=1):
            pass
    shown = capture.get()
    assert shown.count(RED) == 1 and "\x1b[31msaid␛[31m\x1b[0m" in shown and "b␛[31" in shown
    assert "\x1b[?25l" in shown  # The cursor is hidden while a line moves.


def run_into(stream: int | None, *words: str) -> tuple[int, str]:
    """Return how a command ends whose standard output is some stream, and what it says beside it."""
    done = subprocess.run(
        [sys.executable, "-m", "executor.cli.app", *words],
        cwd=ROOT,
        env=environment(),
        stdout=stream,
        stderr=subprocess.PIPE,
        text=True,
        timeout=600,
    )
    return done.returncode, done.stderr


COMMANDS = [["--help"], ["scenes"], ["scenes", "--json"]]


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_a_reader_that_has_gone_is_no_mistake(words: list[str]) -> None:
    process = subprocess.Popen(["true"], stdin=subprocess.PIPE)
    process.wait()
    assert process.stdin is not None
    with process.stdin as unread:
        assert run_into(unread.fileno(), *words) == (141, "")


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_standard_output_without_room_is_said(words: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        code, said = run_into(full.fileno(), *words)
    assert code == 3 and said.count("\n") == 1 and "No space left on device" in said and "Traceback" not in said


def test_a_run_that_goes_back_says_to_what_time(here: Any) -> None:
    with RolloutProgress() as progress:
        progress(Event("subtask-end", 1, 2, -1, "put_glass", 32.1, "no place"))
        progress(Event("revision", 3, 4, -1, "put_glass", 12.9, "glass_0 is taken again from table_0"))
    assert here.readouterr().err == "  back to 12.9 s: glass_0 is taken again from table_0\n"
