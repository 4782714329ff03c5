"""The help of every command: what its options do, in words that a person would type, without the parser's own."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from executor.cli.app import commands as all_commands
from executor.cli.app import run, second_words

_NEGATIONS = re.compile(r"\b(no|not|without|leave out)\b", re.IGNORECASE)


def commands() -> Iterator[tuple[str, ...]]:
    """Yield the words of every command."""
    for name, options in all_commands().items():
        yield tuple(name.split(" "))
        yield from ((name, second) for second in second_words(options))


def help_of(words: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> str:
    """Return a command's help, each option's text on one line."""
    monkeypatch.setenv("COLUMNS", "400")
    assert run([*words, "--help"]) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("words", sorted(commands()), ids=" ".join)
def test_help_speaks_no_python(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = help_of(words, capsys, monkeypatch)
    assert not re.search(r"\b(None|True|False)\b|\(default: *\)", shown)


@pytest.mark.parametrize("words", sorted(commands()), ids=" ".join)
def test_an_option_that_takes_something_back_says_so(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = help_of(words, capsys, monkeypatch).splitlines()
    for line in lines:
        option, _, does = line.strip("│ ").partition(" ")
        if option.startswith("--no-"):
            assert _NEGATIONS.search(does), line


def test_some_options_take_something_back(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    assert "--no-video " in help_of(("run",), capsys, monkeypatch)
    assert "--no-measurements " in help_of(("evolve",), capsys, monkeypatch)


def test_a_value_that_is_left_out_cannot_be_typed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["verify", "task.json", "--apply", "None"]) == 2
    assert "--apply" in capsys.readouterr().err
