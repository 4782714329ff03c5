"""Two real photographs, which lie in scikit-image's wheel: a cup that is picked up, and the floor of a garage."""

from __future__ import annotations

import json
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from executor.cli.app import run
from executor.photo.geometry.observation import observe
from executor.photo.inputs.depth import Depth
from executor.photo.inputs.picture import Intrinsics, read_picture

_PACKAGE = find_spec("skimage")
pytestmark = pytest.mark.skipif(_PACKAGE is None, reason="scikit-image, which has the photographs, is not installed")
PICTURES = Path(_PACKAGE.origin).parent / "data" if _PACKAGE is not None and _PACKAGE.origin else Path()
COFFEE = {"cup": [172, 17, 411, 307], "dining table": [0, 0, 600, 400]}
"""Boxes as a detector finds them. The file says nothing of the lens: 40 degrees are taken for it."""
_MOST_S = 120.0


@pytest.mark.slow
@pytest.mark.physics
def test_a_cup_on_a_real_table_is_picked_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    began = time.process_time()
    things = [{"label": label, "box": box} for label, box in COFFEE.items()]
    (tmp_path / "boxes.json").write_text(json.dumps({"source": "by hand", "things": things}))
    given = ["--boxes", tmp_path / "boxes.json", "--camera", "hfov=40", "--out", tmp_path / "coffee"]
    # Tilt and height as annotated: a scale is no longer guessed from a cup's usual width.
    given += ["--tilt", 53, "--camera-height-m", 1.02]
    assert run(["photo", str(PICTURES / "coffee.png"), *map(str, given), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told["things"]) == {"cup_0", "dining_table_0"}
    scene = json.loads((tmp_path / "coffee" / "scene.json").read_text())
    assert "(ontop cup_0 dining_table_0)" in scene["facts"]
    # The table fills the picture: nothing tells where it ends.
    assert scene["provenance"]["dining_table_0"]["position"].startswith("fitted to the box, +- 1.000 m")
    where = ["--scene", str(tmp_path / "coffee" / "scene.json"), "--json"]
    assert run(["plan", "pick up the cup", *where]) == 0
    assert run(["run", "pick up the cup", *where, "--no-video", "--out", str(tmp_path / "run")]) == 0
    assert time.process_time() - began < _MOST_S


def test_the_floor_of_a_real_garage_is_found() -> None:
    """The motorcycle of Middlebury's stereo set of 2014, at a quarter of its size, with its true disparities."""
    picture = read_picture(PICTURES / "motorcycle_left.png")
    disparity = np.load(PICTURES / "motorcycle_disp.npz")["arr_0"].astype(float)
    depth_m = np.where(np.isfinite(disparity), 994.978 * 0.193001 / (disparity + 31.086), 0.0)
    camera = Intrinsics(994.978, 994.978, 311.193, 254.877, "the set's calibration")
    _, floor = observe(picture, Depth(depth_m, "the set's disparities"), camera)
    # As another, simpler search found it.
    assert floor.height_m == pytest.approx(1.064, abs=0.03) and floor.tilt_deg == pytest.approx(14.6, abs=1.0)
