"""`scene2demo bddl check` and `bddl fmt`, as a person at a terminal runs them."""

from __future__ import annotations

import io
import os
import re
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import bddl
import llm
from bddl import PROFILES
from executor.cli.app import run
from executor.scenes import library
from tests.executor.cli.conftest import ROOT, Answer, Command, environment

SOUND = """(define (problem tidy-0)
    (:domain kitchen)
    (:objects
        glass_0 - glass
        table_0 - table
    )
    (:init
        (open glass_0)
        (open table_0)
    )
    (:goal
        (ontop glass_0 table_0)
    )
)
"""
WRONG = SOUND.replace("(ontop glass_0 table_0)", "(and (on glass_0 table_0) (inside cup_0 table_0))")
SUSPICIOUS = SOUND.replace("(ontop glass_0 table_0)", "(ontop table_0 glass_0)")


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Run one command line in this process, which spares the start of another."""
    monkeypatch.chdir(tmp_path)

    def run_here(*arguments: str | Path) -> Answer:
        code = run(list(map(str, arguments)))
        out, err = capsys.readouterr()
        return Answer(code, out, err)

    return run_here


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in (("sound", SOUND), ("wrong", WRONG), ("suspicious", SUSPICIOUS)):
        (tmp_path / f"{name}.bddl").write_text(text, encoding="utf-8")
    return tmp_path


def test_a_sound_file(command: Command, folder: Path) -> None:
    answer = command("bddl", "check", "sound.bddl")
    assert (answer.code, answer.out) == (0, "")
    assert answer.err == "1 file checked, nothing found\n"


def test_every_mistake_is_shown_with_place_code_excerpt_hint_and_page(command: Command, folder: Path) -> None:
    answer = command("bddl", "check", "wrong.bddl")
    assert answer.code == 1
    assert (
        answer.out
        == """\
wrong.bddl:12:15: error: The profile `scene` has no predicate `on`. [unknown-predicate]
  12 |         (and (on glass_0 table_0) (inside cup_0 table_0))
     |               ^^
  hint: write (ontop glass_0 table_0)
  see docs/codes-bddl.md#unknown-predicate

wrong.bddl:12:43: error: There is no object `cup_0`. [unknown-object]
  12 |         (and (on glass_0 table_0) (inside cup_0 table_0))
     |                                           ^^^^^
  hint: did you mean glass_0?
  see docs/codes-bddl.md#unknown-object

"""
    )
    assert answer.err == "1 file checked: 2 errors\n"


def test_warnings_pass_unless_strict(command: Command, folder: Path) -> None:
    answer = command("bddl", "check", "suspicious.bddl")
    assert answer.code == 0 and "warning: The arguments of `ontop` seem to be swapped" in answer.out
    assert command("bddl", "check", "suspicious.bddl", "--strict").code == 1


def test_json_has_all_of_it(command: Command, folder: Path) -> None:
    answer = command("bddl", "check", ".", "--json")
    assert answer.code == 1 and answer.err == ""
    data = answer.data
    assert (data["ok"], data["errors"], data["warnings"]) == (False, 2, 1)
    assert [(file["file"], file["profile"], file["ok"]) for file in data["files"]] == [
        ("sound.bddl", "scene", True),
        ("suspicious.bddl", "scene", True),
        ("wrong.bddl", "scene", False),
    ]
    first = data["files"][2]["diagnostics"][0]
    assert (first["code"], first["line"], first["column"], first["slip"]) == (
        "unknown-predicate",
        12,
        15,
        "predicate-synonym",
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("nothing.bddl",), "nothing.bddl does not exist"),
        ((), "FILE is missing"),
        (("sound.bddl", "--profile", "sceen"), "--profile sceen: expected one of scene"),
        (("empty",), "empty has no file that ends in .bddl"),
        (("binary.bddl",), "binary.bddl is not UTF-8 text (byte 1); save it in UTF-8"),
    ],
)
@pytest.mark.parametrize("verb", ["check", "fmt"])
def test_misuse(command: Command, folder: Path, verb: str, arguments: tuple[str, ...], said: str) -> None:
    (folder / "empty").mkdir()
    (folder / "binary.bddl").write_bytes(b"(\xff)")
    answer = command("bddl", verb, *arguments)
    assert answer.code == 2 and answer.out == ""
    assert said in answer.err


@pytest.mark.parametrize("verb", ["check", "fmt"])
def test_a_file_that_cannot_be_read_hides_no_other(command: Command, folder: Path, verb: str) -> None:
    (folder / "latin.bddl").write_bytes(SOUND.replace("glass", "gl\xe4s").encode("latin-1"))
    answer = command("bddl", verb, ".")
    assert answer.code == 2
    assert "scene2demo: latin.bddl is not UTF-8 text" in answer.err
    assert "wrong.bddl:12:15: " in answer.out + answer.err
    data = command("bddl", verb, ".", "--json").data
    assert not data["ok"]
    assert {file["file"] for file in data["files"]} >= {"sound.bddl", "suspicious.bddl", "wrong.bddl"}
    if verb == "check":
        (unreadable,) = data["unreadable"]
        assert unreadable["file"] == "latin.bddl" and unreadable["why"].startswith("is not UTF-8 text")
    else:
        assert {"file": "latin.bddl", "outcome": "unreadable"} in data["files"]


@pytest.mark.parametrize("verb", ["check", "fmt"])
def test_a_pipe_is_read_like_a_file(tmp_path: Path, verb: str) -> None:
    reading, writing = os.pipe()
    os.write(writing, SOUND.encode())
    os.close(writing)
    done = subprocess.run(
        [sys.executable, "-m", "executor.cli.app", "bddl", verb, f"/dev/fd/{reading}"],
        cwd=tmp_path, env=environment(), pass_fds=[reading], capture_output=True, text=True,
    )  # fmt: skip
    os.close(reading)
    assert (done.returncode, done.stdout) == (0, SOUND if verb == "fmt" else ""), done.stderr


def test_a_pipe_is_not_written_to(command: Command, tmp_path: Path) -> None:
    reading, writing = os.pipe()
    os.write(writing, " ".join(SOUND.split()).encode())
    os.close(writing)
    answer = command("bddl", "fmt", "--write", f"/dev/fd/{reading}")
    os.close(reading)
    assert answer.code == 2 and "is no file: expected files, and no pipes or devices" in answer.err


def test_a_slip_in_the_domain_does_not_change_the_dialect(command: Command, folder: Path) -> None:
    text = SOUND.replace("kitchen", "omnigibsn")
    for name in ("glass", "table"):
        text = text.replace(f"{name}_0 - {name}", f"{name}.n.01_1 - {name}.n.01").replace(f"{name}_0", f"{name}.n.01_1")
    (folder / "slip.bddl").write_text(text, encoding="utf-8")
    answer = command("bddl", "check", "slip.bddl")
    assert answer.code == 1
    assert "slip.bddl:2:14: error: The profile `behavior` has no domain `omnigibsn`. [unknown-domain]" in answer.out
    assert "did you mean omnigibson?" in answer.out


@pytest.mark.parametrize("verb", ["check", "fmt"])
def test_the_help_lists_the_profiles(command: Command, verb: str) -> None:
    answer = command("bddl", verb, "--help")
    words = re.findall(r"[\w-]+", answer.out)
    assert set(PROFILES) <= set(words) and "{None}" not in answer.out


def test_what_a_file_says_cannot_steer_the_terminal(command: Command, folder: Path) -> None:
    wrong = WRONG.replace("cup_0", "\x1b[31mcup\x07\x00\x9b")
    (folder / "steering.bddl").write_text(wrong, encoding="utf-8")
    answer = command("bddl", "check", "steering.bddl")
    assert answer.code == 1 and "\u241b[31mcup\u2407\u2400\ufffd" in answer.out
    assert not set(answer.out) & {"\x1b", "\x07", "\x00", "\x9b"}
    laid_out = command("bddl", "fmt", "steering.bddl")
    assert laid_out.code == 1 and not set(laid_out.out + laid_out.err) & {"\x1b", "\x07", "\x00", "\x9b"}


def test_the_domain_chooses_the_profile(command: Command, folder: Path) -> None:
    text = SOUND.replace("kitchen", "omnigibson")
    (folder / "behavior.bddl").write_text(text, encoding="utf-8")
    answer = command("bddl", "check", "behavior.bddl", "--json")
    assert answer.data["files"][0]["profile"] == "behavior"
    assert command("bddl", "check", "behavior.bddl", "--profile", "scene").code == 0


@pytest.mark.parametrize("verb", ["check", "fmt"])
def test_the_standard_input(command: Command, monkeypatch: pytest.MonkeyPatch, verb: str) -> None:
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(WRONG.encode())))
    answer = command("bddl", verb, "-")
    assert answer.code == 1
    assert "<stdin>:12:15: " in answer.out + answer.err


def test_the_standard_input_from_a_shell(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "executor.cli.app", "bddl", "fmt", "-"],
        cwd=tmp_path, env=environment(), input=" ".join(SOUND.split()), capture_output=True, text=True,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, SOUND, "")


def test_fmt_prints_and_changes_nothing(command: Command, folder: Path) -> None:
    untidy = " ".join(SOUND.split())
    (folder / "untidy.bddl").write_text(untidy, encoding="utf-8")
    answer = command("bddl", "fmt", "untidy.bddl")
    assert (answer.code, answer.out, answer.err) == (0, SOUND, "")
    assert (folder / "untidy.bddl").read_text(encoding="utf-8") == untidy


def test_fmt_check_names_what_would_change(command: Command, folder: Path) -> None:
    (folder / "untidy.bddl").write_text(" ".join(SOUND.split()), encoding="utf-8")
    answer = command("bddl", "fmt", "untidy.bddl", "sound.bddl", "--check")
    assert (answer.code, answer.out, answer.err) == (1, "", "would change: untidy.bddl\n")
    assert command("bddl", "fmt", "sound.bddl", "--check").code == 0
    assert command("bddl", "fmt", "sound.bddl", "--check", "--write").code == 2


def test_fmt_write_keeps_comments_line_ends_links_and_permissions(command: Command, folder: Path) -> None:
    untidy = folder / "untidy.bddl"
    untidy.write_bytes(SOUND.replace("    (:init", "  ; the start\n(:init").replace("\n", "\r\n").encode())
    untidy.chmod(0o640)
    (folder / "link.bddl").symlink_to("untidy.bddl")
    answer = command("bddl", "fmt", "link.bddl", "--write")
    assert (answer.code, answer.out, answer.err) == (0, "", "changed: link.bddl\n")
    assert (
        untidy.read_bytes() == SOUND.replace("    (:init", "    ; the start\n    (:init").replace("\n", "\r\n").encode()
    )
    assert stat.S_IMODE(untidy.stat().st_mode) == 0o640
    assert (folder / "link.bddl").is_symlink()
    assert sorted(path.name for path in folder.iterdir() if "part" in path.name) == []


def test_fmt_leaves_a_file_with_mistakes_alone(command: Command, folder: Path) -> None:
    answer = command("bddl", "fmt", ".", "--write")
    assert answer.code == 1
    assert "wrong.bddl:12:15: The profile `scene` has no predicate `on`. [unknown-predicate] (and 1 more" in answer.err
    assert (folder / "wrong.bddl").read_text(encoding="utf-8") == WRONG


def test_neither_loads_what_takes_time() -> None:
    code = (
        "import sys\nfrom executor.cli.app import run\n"
        "run(['bddl', 'check', 'docs'])\n"
        "sys.exit(','.join(sorted(set(sys.modules) & {'torch', 'sapien', 'numpy', 'z3', 'oag', 'llm'})) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_control_c_ends_in_one_line(command: Command, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(text: str, profile: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("bddl.analyse", interrupted)
    answer = command("bddl", "check", "sound.bddl")
    assert (answer.code, answer.out, answer.err) == (130, "", "scene2demo: interrupted\n")


def test_no_file_is_half_written(command: Command, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    untidy = " ".join(SOUND.split())
    (folder / "untidy.bddl").write_text(untidy, encoding="utf-8")

    def interrupted(*paths: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("shutil.copymode", interrupted)
    assert command("bddl", "fmt", "untidy.bddl", "--write").code == 130
    assert (folder / "untidy.bddl").read_text(encoding="utf-8") == untidy
    assert [path.name for path in folder.iterdir() if "part" in path.name] == []


def test_many_files_are_counted_on_a_terminal_only(command: Command, folder: Path) -> None:
    for index in range(30):
        (folder / f"copy_{index}.bddl").write_text(SOUND, encoding="utf-8")
    answer = command("bddl", "check", ".", "--profile", "scene")
    assert answer.err == "33 files checked: 2 errors, 1 warning in 2 of them\n"


@pytest.mark.parametrize(
    ("scene", "query"),
    [
        ("kitchen_t1", "put the glass into the refrigerator"),
        ("kitchen_t2", "put the apple into the refrigerator"),
        ("kitchen_t3", "put the apple into the bowl"),
        ("kitchen_t4", "put the glass into the cabinet"),
    ],
)
def test_what_a_proposal_writes_is_sound_without_any_option(
    command: Command, tmp_path: Path, scene: str, query: str
) -> None:
    for number, problem in enumerate(llm.propose(query, library.load(scene)).problems):
        (tmp_path / f"sub_task_{number}.bddl").write_text(bddl.format(problem), encoding="utf-8")
    answer = command("bddl", "check", tmp_path, "--json")
    assert answer.code == 0, answer.out
    assert {file["profile"] for file in answer.data["files"]} == {"scene"}
