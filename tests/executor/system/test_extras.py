"""A missing optional library ends in one sentence that names the extra and the command."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path

import pytest

from executor.reports.run_folder import ResultsExist
from executor.scenes.library import SceneNotFound
from executor.scenes.pair import NotDrawn
from executor.system import extras
from llm.errors import QueryError
from oag import SceneError


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


@pytest.mark.parametrize(
    "error",
    [
        extras.MissingExtra("sapien.render", "sim", "libX11.so.6: cannot open"),
        NotDrawn("T1-000007", ["no room for the table", "the glass fell"]),
        ResultsExist(Path("run"), ["rollout.json", "video.mp4"]),
        SceneNotFound("kitchen_t11", ("kitchen_t1", "kitchen_t2")),
        SceneError("no such object", source="room.json", place="objects.glass_0", hint="it has cup_0"),
        QueryError("unknown-object", "take the moon", "there is no moon", suggestions=("take the glass",)),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_of_several_arguments_cross_processes(error: Exception) -> None:
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is type(error) and str(copy) == str(error) and copy.__dict__ == error.__dict__


def test_missing_lists_only_what_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "EXTRAS", {"data": ("pytest", "no-such-distribution-here")})
    assert extras.missing("data") == ("no-such-distribution-here",)
