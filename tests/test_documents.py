"""The documentation agrees with the program: generated pages, links, files, commands and code."""

from __future__ import annotations

import ast
import builtins
import contextlib
import doctest
import io
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import build_docs
import pytest

from executor.cli.app import TWO_WORDS, run
from executor.cli.app import _parse as parse_command
from tests.source_tree import ROOT

DOCS = sorted((ROOT / "docs").glob("*.md"))
PAGES = [ROOT / "README.md", *DOCS]
MOST_LINES = 3500
_SNIPPET = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\((?!https?:)([^)\s#]*)(#[^)\s]+)?\)")
_SOURCE = re.compile(r"`((?:bddl|oag|llm|executor|scripts|benchmarks|tests|examples)/[\w./-]*(?:\.\w+|/))`")
# Snippets that start the simulator.
_WITH_PHYSICS = {"index", "datasets", "scenes", "README"}
# Snippets that ask a model.
_WITH_A_MODEL = "connect("


def test_the_generated_pages_are_up_to_date() -> None:
    """`python scripts/build_docs.py` writes them."""
    stale = [path.name for path, text in build_docs.pages().items() if path.read_text(encoding="utf-8") != text]
    assert not stale


def test_the_pages_are_short() -> None:
    assert sum(len(page.read_text(encoding="utf-8").splitlines()) for page in DOCS) <= MOST_LINES


def _anchors(page: Path) -> set[str]:
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", DOCS, ids=lambda page: page.stem)
def test_the_links_of_a_page_lead_somewhere(page: Path) -> None:
    for target, anchor in _LINK.findall(page.read_text(encoding="utf-8")):
        path = page.parent / target if target else page
        assert path.is_file(), target
        assert not anchor or anchor[1:] in _anchors(path), f"{target}{anchor}"


@pytest.mark.parametrize("page", DOCS, ids=lambda page: page.stem)
def test_every_source_file_that_a_page_names_exists(page: Path) -> None:
    named = _SOURCE.findall(page.read_text(encoding="utf-8"))
    assert not [path for path in named if not (ROOT / path).exists() and not re.search("_K|NAME", path)]


def command_lines(page: Path) -> Iterator[str]:
    """Yield each command of the program in an indented or fenced block of a page."""
    text = re.sub(r"\\\n\s*", "", page.read_text(encoding="utf-8"))
    for line in text.splitlines():
        found = re.match(r"(?: {4}| {2})?(?:\.venv/bin/)?(scene2demo (?!\[).*)", line)
        if found:
            yield found[1]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_command_of_a_page_is_one_that_the_program_reads(page: Path) -> None:
    for line in command_lines(page):
        words = shlex.split(re.sub(r" \[[^\]]*\]|  #.*|\s*$", "", line).replace("$SLURM_ARRAY_TASK_ID", "1"))[1:]
        words = [" ".join(words[:2]), *words[2:]] if tuple(words[:2]) in TWO_WORDS else words
        with contextlib.redirect_stderr(io.StringIO()) as told:
            try:
                parse_command(words)
            except SystemExit:
                pytest.fail(f"{line}\n{told.getvalue()}")


def _tutorial() -> list[list[str]]:
    """Return the tutorial's commands; those that need a model are left out."""
    lines = command_lines(ROOT / "docs" / "tutorial-sentence.md")
    return [shlex.split(line)[1:] for line in lines if "--model" not in line]


def test_the_tutorial_repairs_a_plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        codes = [run(words) for words in _tutorial() if words[0] == "verify"]
    assert codes == [1, 0]
    assert (tmp_path / "runs" / "fixed.json").is_file()


@pytest.mark.slow
@pytest.mark.physics
def test_the_tutorial_s_commands_run_in_order(tmp_path: Path) -> None:
    """Pictures are left out, and one episode stands for ten."""
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    for words in _tutorial():
        typed = ["1" if before == "--episodes" else word for before, word in zip(["", *words], words, strict=False)]
        typed += ["--no-video"] if words[0] == "run" else []
        line = [sys.executable, "-m", "executor", *typed]
        done = subprocess.run(line, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        refuted = words[0] == "verify" and "--apply" not in words
        assert done.returncode == int(refuted), f"{' '.join(typed)}\n{done.stdout}\n{done.stderr}"


def snippets(page: Path) -> list[str]:
    """Return the pieces of Python of a page; of a dialogue with the interpreter, what was typed."""
    found = _SNIPPET.findall(page.read_text(encoding="utf-8"))
    typed = doctest.DocTestParser().get_examples
    return ["".join(line.source for line in typed(text)) if ">>> " in text else text for text in found]


def bound(tree: ast.AST) -> set[str]:
    """Return the names that a piece gives a meaning."""
    names: set[str] = set()
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name):
                names.add(name)
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                names.add(name)
            case ast.Import(names=imported) | ast.ImportFrom(names=imported):
                names |= {(entry.asname or entry.name).partition(".")[0] for entry in imported}
    return names


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_snippet_names_nothing_that_neither_it_nor_one_before_it_has(page: Path) -> None:
    known = set(dir(builtins))
    for text in snippets(page):
        tree = ast.parse(text)
        known |= bound(tree)
        used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
        assert used <= known, f"{page.name}: {sorted(used - known)} in\n{text}"


def _pieces() -> Iterator[object]:
    for page in PAGES:
        for number, text in enumerate(snippets(page)):
            # The page about the language is a dialogue, which its own test runs.
            if page.stem != "bddl" and _WITH_A_MODEL not in text:
                marks = [pytest.mark.physics, pytest.mark.slow] if page.stem in _WITH_PHYSICS else []
                yield pytest.param(text, marks=marks, id=f"{page.stem}-{number}")


@pytest.mark.parametrize("text", [*_pieces()])
def test_a_snippet_runs(text: str, tmp_path: Path) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    # A checkout that is not installed names the module of its environments.
    text = text.replace('"scene2demo/', '"executor.envs:scene2demo/')
    line = [sys.executable, "-c", text]
    done = subprocess.run(line, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
