"""Depths and boxes that are not of their picture are refused or reported, and right ones are taken."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from executor.assets.library import LIBRARY
from executor.cli.app import run
from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.geometry.observation import Observation
from executor.photo.inputs.annotations import boxes_in, read_boxes
from executor.photo.inputs.consistency import box_doubts, depth_doubts
from executor.photo.inputs.depth import Depth
from executor.photo.inputs.picture import Exif, Intrinsics, Photograph, read_picture
from llm.vision import Box
from tests.executor.photo.test_fit import BOWL, TABLE, seen_from_above

CABINET = PoseHypothesis(LIBRARY["cabinet_two_doors"], 3.0, -0.9, 0.2, 0.0, (0.6, 0.8, 0.8))
CHAIR = PoseHypothesis(LIBRARY["chair_wooden"], 2.2, 1.0, 1.2, 0.0, (0.42, 0.41, 0.88))
_PACKAGE = find_spec("skimage")
Case = tuple[Photograph, Array, Intrinsics]


def photograph(rgb: np.ndarray) -> Photograph:
    """Return pixels as a photograph."""
    return Photograph(Path("room.png"), np.ascontiguousarray(rgb), Exif(None, None, ""))


def furnished() -> tuple[Observation, list[Box]]:
    """Return a floor with a table, a bowl, a cabinet and a chair, 640 x 480, and their boxes."""
    seen, boxes = seen_from_above(TABLE, BOWL, CABINET, CHAIR, finer=2)
    return seen, [one.box_px for one in boxes]


def drawn() -> Case:
    """Return the furnished floor."""
    seen, _ = furnished()
    return photograph(seen.rgb), seen.z_m, seen.K


def planes() -> Case:
    """Return a floor 1.5 m under a level camera and a wall 4 m before it, of two colours, with noise."""
    camera = Intrinsics(280.0, 280.0, 160.0, 120.0, "drawn")
    down = camera.rays((320, 240))[..., 1]
    floor_m = np.where(down > 0.0, 1.5 / np.maximum(down, 1e-6), np.inf)
    z_m = np.minimum(floor_m, 4.0) + np.random.default_rng(0).normal(size=down.shape) * 0.01
    rgb = np.where((floor_m < 4.0)[..., None], np.uint8([120, 110, 100]), np.uint8([220, 220, 215]))
    return photograph(rgb), z_m, camera


def garage() -> Case:
    """Return the motorcycle of Middlebury's stereo set of 2014, at a quarter of its size, with its true disparities."""
    if _PACKAGE is None or _PACKAGE.origin is None:
        pytest.skip("scikit-image, which has the photograph, is not installed")
    pictures = Path(_PACKAGE.origin).parent / "data"
    disparity = np.load(pictures / "motorcycle_disp.npz")["arr_0"].astype(float)
    z_m = np.where(np.isfinite(disparity), 994.978 * 0.193001 / (disparity + 31.086), 0.0)
    camera = Intrinsics(994.978, 994.978, 311.193, 254.877, "the set's calibration")
    return read_picture(pictures / "motorcycle_left.png"), z_m, camera


def stretched(z_m: Array, shape: tuple[int, ...]) -> Array:
    """Return a depth scaled to another shape, by its nearest values."""
    rows, columns = (np.arange(new) * old // new for new, old in zip(shape, z_m.shape, strict=True))
    return z_m[rows][:, columns]


def distances(z_m: Array, camera: Intrinsics) -> Array:
    """Return distances along the rays."""
    return z_m * np.linalg.norm(camera.rays(z_m.shape[::-1]), axis=-1)


def enlarged(z_m: Array, by: float) -> Array:
    """Return what a camera with a longer lens measures, as large as before."""
    rows, columns = ((np.arange(side) - side / 2) / by + side / 2 for side in z_m.shape)
    return z_m[rows.astype(int)][:, columns.astype(int)]


@pytest.mark.parametrize("case", [drawn, planes, garage])
def test_a_right_depth_is_taken(case: Callable[[], Case]) -> None:
    picture, z_m, camera = case()
    assert depth_doubts(picture, Depth(z_m, "depth.png"), camera)[1] == ()
    holes = np.random.default_rng(1).random(z_m.shape) < 0.2
    noisy = z_m + np.random.default_rng(2).normal(size=z_m.shape) * 0.012 * z_m
    assert depth_doubts(picture, Depth(np.where(holes, 0.0, noisy), "depth.png"), camera)[1] == ()


@pytest.mark.parametrize("case", [drawn, planes, garage])
@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda z, camera: z[::-1, ::-1], "lies otherwise than the picture"),
        (lambda z, camera: stretched(np.rot90(z), z.shape), "lies otherwise than the picture"),
        (lambda z, camera: stretched(z.T, z.shape), "lies otherwise than the picture"),
        (distances, "distances along the rays"),
    ],
)
def test_a_depth_that_lies_otherwise_or_has_distances_is_refused(
    case: Callable[[], Case], spoil: Callable[[Array, Intrinsics], Array], said: str
) -> None:
    picture, z_m, camera = case()
    with pytest.raises(PhotoRefused, match=said) as caught:
        depth_doubts(picture, Depth(spoil(z_m, camera), "depth.png"), camera)
    assert caught.value.kind == "depth"


@pytest.mark.parametrize("case", [drawn, garage])
@pytest.mark.parametrize("by", [1.25, 1.5])
def test_a_depth_of_a_camera_with_another_lens_is_refused(case: Callable[[], Case], by: float) -> None:
    picture, z_m, camera = case()
    with pytest.raises(PhotoRefused, match="of another camera than the picture") as caught:
        depth_doubts(picture, Depth(enlarged(z_m, by), "depth.png"), camera)
    (scale,) = (float(one) for one in re.findall("when it is ([0-9.]+) times as large", str(caught.value)))
    assert scale * by == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("case", [drawn, garage])
def test_a_depth_of_the_neighbouring_lens_is_laid_over_the_picture(case: Callable[[], Case]) -> None:
    picture, z_m, camera = case()
    laid, (said,) = depth_doubts(picture, Depth(enlarged(z_m, 1.1), "depth.png"), camera)
    assert "of another camera than the picture" in said
    both = (laid.z_m > 0.0) & (z_m > 0.0)
    assert np.mean(np.abs(laid.z_m - z_m)[both] < 0.05 * z_m[both]) > 0.9


def test_a_depth_of_another_moment_is_reported() -> None:
    picture, _, camera = drawn()
    elsewhere = PoseHypothesis(LIBRARY["wardrobe_two_doors"], 2.6, 0.9, 0.5, 0.0, (0.6, 1.0, 1.2))
    _, (said,) = depth_doubts(picture, Depth(seen_from_above(elsewhere, finer=2)[0].z_m, "depth.png"), camera)
    assert "both of one camera and moment" in said


def test_where_there_is_no_edge_nothing_is_reported() -> None:
    picture, z_m, camera = planes()
    grey = photograph(np.full_like(picture.rgb, 128))
    assert depth_doubts(grey, Depth(z_m, "depth.png"), camera)[1] == ()
    assert depth_doubts(picture, Depth(np.full_like(z_m, 2.5), "depth.png"), camera)[1] == ()


@pytest.mark.parametrize("shape", [(64, 4096), (4096, 64), (64, 64), (333, 517)])
def test_pictures_of_every_shape_are_compared(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    picture = photograph(rng.integers(0, 255, (*shape, 3), dtype=np.uint8))
    z_m = np.where(rng.random(shape) < 0.5, 0.0, rng.uniform(1.0, 4.0, shape))
    camera = Intrinsics(0.8 * shape[1], 0.8 * shape[1], shape[1] / 2, shape[0] / 2, "drawn")
    assert len(depth_doubts(picture, Depth(z_m, "depth.png"), camera)[1]) <= 1
    assert len(box_doubts(Path("boxes.json"), [(1.0, 1.0, 9.0, 9.0), (5.0, 5.0, 16.0, 16.0)], picture)) <= 1


@pytest.mark.parametrize(("size_px", "said"), [((1600, 1200), "thousandths"), ((1280, 960), "640 x 480 pixels")])
def test_boxes_of_another_size_are_refused_and_right_ones_taken(
    tmp_path: Path, size_px: tuple[int, int], said: str
) -> None:
    seen, boxes = furnished()
    large = photograph(np.asarray(Image.fromarray(seen.rgb).resize(size_px, Image.Resampling.BICUBIC)))
    factor, path = size_px[0] / seen.size_px[0], tmp_path / "boxes.json"
    right = [tuple(factor * side for side in box) for box in boxes]
    assert box_doubts(path, right, large) == ()  # type: ignore[arg-type]
    for some in ((0, 2), (1, 3), (0, 1, 3)):
        assert box_doubts(path, [right[index] for index in some], large) == ()  # type: ignore[misc]
    whole = (1000, 1000) if said == "thousandths" else seen.size_px
    wrong = [[side * whole[axis % 2] / size_px[axis % 2] for axis, side in enumerate(box)] for box in right]
    things = [{"label": "thing", "box": box} for box in wrong]
    path.write_text(json.dumps({"things": things}))
    with pytest.raises(PhotoRefused, match=said) as caught:
        boxes_in(path, "room.png")(large)
    assert caught.value.kind == "boxes" and '"size_px"' in str(caught.value)
    # One alone may be of something in the corner: it is reported.
    path.write_text(json.dumps({"things": things[:1]}))
    assert [said in doubt for doubt in boxes_in(path, "room.png")(large).doubts] == [True]
    # The hint is followed.
    path.write_text(json.dumps({"size_px": whole, "things": things}))
    found = boxes_in(path, "room.png")(large)
    assert np.allclose([one.box_px for one in found.things], right) and "are scaled to" in found.doubts[0]


def test_the_size_that_a_file_says_of_its_picture_scales_its_boxes(tmp_path: Path) -> None:
    coco = {
        "images": [{"id": 1, "file_name": "room.png", "width": 160, "height": 120}],
        "categories": [{"id": 1, "name": "cup"}],
        "annotations": [{"image_id": 1, "category_id": 1, "bbox": [16, 12, 64, 48]}],
    }
    points = [[16, 12], [80, 60]]
    labelme = {"imageWidth": 160, "imageHeight": 120, "shapes": [{"label": "cup", "points": points}]}
    for name, content in {"coco.json": coco, "labelme.json": labelme}.items():
        (tmp_path / name).write_text(json.dumps(content))
        (found,) = read_boxes(tmp_path / name, (320, 240), "room.png")
        assert found.box_px == (32.0, 24.0, 160.0, 120.0)
        with pytest.raises(PhotoRefused, match="of a picture of 160 x 120 pixels, and this one has 240 x 320"):
            read_boxes(tmp_path / name, (240, 320), "room.png")
    (tmp_path / "own.json").write_text(
        json.dumps({"size_px": [0, 9], "things": [{"label": "cup", "box": [1, 1, 9, 9]}]})
    )
    with pytest.raises(PhotoRefused, match="no width and height"):
        read_boxes(tmp_path / "own.json", (320, 240))


def test_the_command_refuses_what_is_not_of_its_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    seen, boxes = furnished()
    Image.fromarray(seen.rgb).save(tmp_path / "room.png")
    (tmp_path / "boxes.json").write_text(json.dumps({"things": [{"label": "table", "box": boxes[0]}]}))
    (tmp_path / "camera.json").write_text(
        json.dumps({name: getattr(seen.K, name) for name in ("fx", "fy", "cx", "cy")})
    )
    given = ["--camera", str(tmp_path / "camera.json"), "--boxes", str(tmp_path / "boxes.json")]
    ends = {
        "it lies on its side: turn it by 90 degrees": np.rot90(seen.z_m),
        "it is shaped otherwise": seen.z_m[60:-60],
        "lies otherwise than the picture": seen.z_m[::-1, ::-1],
        "distances along the rays": distances(seen.z_m, seen.K),
        "of another camera": enlarged(seen.z_m, 1.4),
    }
    for said, z_m in ends.items():
        np.save(tmp_path / "depth.npy", z_m)
        words = ["photo", str(tmp_path / "room.png"), "--depth", str(tmp_path / "depth.npy"), *given]
        assert run([*words, "--out", str(tmp_path / "out")]) == 2
        assert said in " ".join(capsys.readouterr().err.split()) and not (tmp_path / "out").exists()
