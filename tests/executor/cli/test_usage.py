"""What is typed wrongly is told with its likeness, and a file that is not there before anything is loaded."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from executor.cli.app import commands, option_names, run, second_words
from tests.executor.cli.conftest import ROOT, environment

NAMED = {
    **{tuple(name.split(" ")): options for name, options in commands().items() if not second_words(options)},
    **{(name, second): one for name, options in commands().items() for second, one in second_words(options).items()},
}


@pytest.mark.parametrize("words", sorted(NAMED), ids=" ".join)
def test_the_known_options_are_those_of_the_help(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    assert run([*words, "--help"]) == 0
    shown = re.findall(r"^[^\w-]*(?:-h, |-\w [A-Z]+, )?(--[a-z][a-z-]*)", capsys.readouterr().out, re.MULTILINE)
    assert set(shown) == set(option_names(NAMED[words]))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("rum open --scene kitchen_t1", "there is no command 'rum'; did you mean run?"),
        ("evaluat p", "there is no command 'evaluat'; did you mean evaluate?"),
        ("zzz", "there is no command 'zzz'; there are run, plan, tasks, stability, rollout"),
        ("dataset exprt s", "there is no command 'dataset exprt'; did you mean export?"),
        ("bddl chek f", "there is no command 'bddl chek'; did you mean check?"),
        ("assets imprt f", "assets takes no 'imprt'; did you mean assets import?"),
        ("bench replya f u --out o", "bench takes no 'replya'; did you mean bench replay?"),
        ("--versoin", "scene2demo has no option --versoin before a command; did you mean --version?"),
        ("run open --scene kitchen_t1 --output r", "run has no option --output; did you mean --out?"),
        ("run open --scene kitchen_t1 --out r --seeds=3", "run has no option --seeds; did you mean --seed?"),
        ("run open --scene kitchen_t1 --out r --no_vidoe", "run has no option --no-vidoe; did you mean --no-video?"),
        ("evolve t.json --scene kitchen_t1 --look-bakc 2", "did you mean --look-back?"),
        ("dataset export s --outt o", "dataset export has no option --outt; did you mean --out?"),
        ("assets import f --nam o", "assets import has no option --nam; did you mean --name?"),
        ("verify t.json --zzz", "verify has no option --zzz; there are --json, --debug, --scene, --domain, --out"),
        ("rum\x1b[31m x", r"there is no command 'rum\x1b[31m'"),
    ],
)
def test_what_is_mistyped_gets_its_likeness(line: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(line.split(" ")) == 2
    told = capsys.readouterr()
    assert told.out == "" and message in told.err and told.err.count("\n") == 1


def test_numbers_below_zero_are_no_options(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["run", "open", "--out", "r", "--seed", "-1"]) == 2
    assert "no option" not in capsys.readouterr().err


@pytest.mark.parametrize("line", ["run {} --scene kitchen_t1 --out r", "run --scene kitchen_t1 --out r {}"])
def test_a_sentence_needs_no_quotes(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    said, words = "put the unicorn into the refrigerator", line.split(" ")
    place = words.index("{}")
    told = []
    for sentence in ([said], said.split(" ")):
        assert run([*words[:place], *sentence, *words[place + 1 :]]) == 2
        told.append(capsys.readouterr().err)
    assert told[0] == told[1] and "unicorn" in told[0]


@pytest.mark.parametrize("command", ["run", "plan"])
def test_a_missing_sentence_is_asked_for(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([command, "--scene", "kitchen_t1", *(["--out", "r"] if command == "run" else [])]) == 2
    assert "a sentence is missing" in capsys.readouterr().err


def test_the_version_is_that_of_the_project(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == 0
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert capsys.readouterr().out == f"scene2demo {version}\n"


MISSING = [
    ("run open --scene no.json --out r", "scene no.json: cannot be read: No such file or directory"),
    ("plan open --scene no/kitchen", "scene no/kitchen: cannot be read: No such file or directory"),
    ("verify no.json", "task no.json: cannot be read: No such file or directory"),
    ("rollout no.json --scene kitchen_t1", "task no.json: cannot be read: No such file or directory"),
    ("recheck no.json", "certificate no.json: cannot be read: No such file or directory"),
    ("photo no.jpg --out r", "no.jpg: No such file or directory"),
    ("dataset info no", "no: No such file or directory"),
    ("train state --data no --out r", "no: No such file or directory"),
    ("evaluate no", "no: No such file or directory"),
]


def test_a_missing_file_is_told_before_anything_is_loaded(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom executor.cli.app import run\n"
        f"codes = [run(line.split()) for line in {[line for line, _ in MISSING]!r}]\n"
        "names = {name.split('.')[0] for name in sys.modules}\n"
        "print(codes, sorted(names & {'numpy', 'scipy', 'oag', 'llm', 'pydantic', 'torch', 'sapien'}))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment(), capture_output=True, text=True)
    assert done.stdout == f"{[2] * len(MISSING)} []\n"
    assert done.stderr.splitlines() == [f"scene2demo: {message}" for _, message in MISSING]
