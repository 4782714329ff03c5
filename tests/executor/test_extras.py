"""A missing optional library ends in one sentence that names the extra and the command."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from executor.machine import extras


def test_what_is_installed_is_returned() -> None:
    assert extras.require("json", "data").__name__ == "json"


def test_what_is_missing_names_its_extra_and_the_command() -> None:
    with pytest.raises(extras.MissingExtra) as caught:
        extras.require("no_such_module_here.inner", "sim")
    assert str(caught.value) == (
        "This needs no_such_module_here.inner, from the extra 'sim'. In the checkout, run: pip install -e '.[sim]'"
    )


def test_a_library_that_cannot_be_loaded_is_not_called_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "broken_library_here.py").write_text("raise OSError('libX11.so.6: cannot open')\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(extras.MissingExtra, match=r"installed but cannot be loaded: libX11\.so\.6.*make repair"):
        extras.require("broken_library_here", "sim")
    assert "broken_library_here" not in sys.modules


def test_missing_lists_only_what_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "EXTRAS", {"data": ("pytest", "no-such-distribution-here")})
    assert extras.missing("data") == ("no-such-distribution-here",)
