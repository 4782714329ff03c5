"""One idea a file: no file is long."""

from __future__ import annotations

from tests.source_tree import ROOT, modules

MOST_LINES = 400


def line_counts() -> dict[str, int]:
    """Returns file -> number of lines for every module of the packages."""
    return {
        str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines()) for path in modules().values()
    }


def test_no_file_is_long() -> None:
    long = {name: lines for name, lines in line_counts().items() if lines > MOST_LINES}
    assert not long, f"split these, one idea a file: {long}"
