"""A family of assets that is added as one file is part of the library, as CONTRIBUTING.md says."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.source_tree import ROOT

FAMILY = ROOT / "examples" / "added" / "trays.py"
MOST_LINES = 80
# A fresh process, since the library is built once; the folder stands for a copy beside the families of the package.
CODE = """
import json, sys
from executor.assets import families
families.__path__.append(sys.argv[1])
import llm, oag
from executor.assets.asset_geometry import bounds
from executor.assets.library import LIBRARY, asset_for, kind, sample
from executor.scenes.file import complete_scene
obj = sample("tray_two_handles", 0)
low, high = bounds(asset_for(obj))
table, tray, apple = ("table", "position", [0.9, -0.6]), ("tray", "on", "table_0"), ("apple", "on", "table_0")
objects = {f"{category}_0": {"category": category, key: value} for category, key, value in (table, tray, apple)}
scene = complete_scene({"name": "s", "objects": objects}).scene
verdict = oag.compose(llm.propose("put the apple on the tray", scene).task).verify().verdict
print(json.dumps([list(LIBRARY)[-1], kind(LIBRARY["tray_two_handles"]).value, list(high - low), obj.extent_m,
                  scene.objects["tray_0"].model, verdict.name]))
"""


def run_with(folder: Path) -> subprocess.CompletedProcess[str]:
    """Return what the library does with the files of a folder added."""
    command = [sys.executable, "-c", CODE, str(folder)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('FAMILIES = {"tray": tray}', 'FAMILIES = {"cup": tray}', "the category's word 'cup' is given by"),
        ('"tray_two_handles"', '"mug"', "the model 'mug' is given by"),
    ],
)
def test_a_name_that_the_library_has_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = FAMILY.read_text(encoding="utf-8")
    assert old in text
    (tmp_path / FAMILY.name).write_text(text.replace(old, new), encoding="utf-8")
    done = run_with(tmp_path)
    (last,) = done.stderr.splitlines()[-1:]
    assert done.returncode == 1 and last.startswith("executor.assets.library.NameTaken: ")
    assert f"{FAMILY.name}: {message}" in last and "library.py" in last


def test_a_tray_with_handles_takes_one_file(tmp_path: Path) -> None:
    text = FAMILY.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= MOST_LINES
    (tmp_path / FAMILY.name).write_text(text, encoding="utf-8")
    done = run_with(tmp_path)
    assert done.returncode == 0, done.stderr
    model, kind, size_m, extent_m, chosen, verdict = json.loads(done.stdout)
    assert (model, kind, chosen, verdict) == ("tray_two_handles", "item", "tray_two_handles", "PROVED")
    assert max(abs(one - other) for one, other in zip(size_m, extent_m, strict=True)) < 1e-6
