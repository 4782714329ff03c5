"""What a reader meets first: README, changelog, CONTRIBUTING, SECURITY, templates, hooks and workflows."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path

import pytest

from tests.source_tree import ROOT

yaml = pytest.importorskip("yaml")

README = (ROOT / "README.md").read_text(encoding="utf-8")
CHANGES = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
PAGES = ("README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md")
MOST_BYTES, MOST_STATEMENTS, MOST_ENTRIES = 5000, 10, 25


def python_of_the_readme() -> str:
    """Return the README's only piece of Python."""
    (snippet,) = re.findall(r"^```python\n(.*?)^```", README, re.MULTILINE | re.DOTALL)
    assert isinstance(snippet, str)
    return snippet


def test_the_readme_is_short_and_moves() -> None:
    assert len(README.encode()) <= MOST_BYTES
    assert len(ast.parse(python_of_the_readme()).body) <= MOST_STATEMENTS
    (picture,) = re.findall(r"!\[[^]]*\]\(([^)]+)\)", README)
    # An animated WebP says so in its header.
    content = (ROOT / picture).read_bytes()
    assert content[8:12] == b"WEBP" and b"ANIM" in content[:64]


@pytest.mark.physics
def test_the_python_of_the_readme_runs(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(python_of_the_readme(), "README.md", "exec"), {})
    assert capsys.readouterr().out.startswith("Verdict.PROVED True ")


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page: str) -> None:
    targets = re.findall(r"\]\(([^)#]+)[^)]*\)", (ROOT / page).read_text(encoding="utf-8"))
    assert not [target for target in targets if "://" not in target and not (ROOT / target).exists()]


def test_a_release_has_few_entries_and_a_date() -> None:
    sections = dict(re.findall(r"^## (.+)\n((?:(?!## ).*\n)*)", CHANGES, re.MULTILINE))
    assert next(iter(sections)) == "Unreleased"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert any(title.startswith(f"{project['version']} (") for title in sections)
    for title, text in sections.items():
        assert title == "Unreleased" or re.fullmatch(r"\d+\.\d+\.\d+ \(\d{4}-\d\d-\d\d\)", title)
        assert len(re.findall(r"^- ", text, re.MULTILINE)) <= MOST_ENTRIES


def test_every_promise_of_security_names_tests_that_exist() -> None:
    page = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
    promises = page.partition("## Promises")[2].partition("\n## ")[0].splitlines()
    rows = [line for line in promises if line.startswith("| ") and "promise | test" not in line]
    assert len(rows) >= 15
    for row in rows:
        named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", row)
        assert named, row
        for file, test in named:
            assert f"def {test}(" in (ROOT / file).read_text(encoding="utf-8"), row


@pytest.mark.parametrize(
    "path",
    sorted([*(ROOT / ".github").rglob("*.yml"), ROOT / ".pre-commit-config.yaml"]),
    ids=lambda path: path.name,
)
def test_configurations_can_be_read(path: Path) -> None:
    assert isinstance(yaml.safe_load(path.read_text(encoding="utf-8")), dict)


def test_workflows_and_hooks_run_what_exists() -> None:
    """Workflows call targets of the Makefile; commits are checked by ruff, mypy and import-linter."""
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    workflows = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / ".github/workflows").glob("*.yml")}
    assert {"tests", "docs", "release"} <= set(workflows)
    assert {name for text in workflows.values() for name in re.findall(r"run: make ([a-z-]+)", text)} <= targets
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"][0]["hooks"]
    assert {"ruff", "mypy", "import-linter"} <= {hook["id"] for hook in hooks}
