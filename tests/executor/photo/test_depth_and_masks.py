"""Networks that guess depth and find masks: answers land in the picture's pixels, and record that they are guesses."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from executor.cli.app import run
from executor.photo.errors import PhotoRefused
from executor.photo.inputs.annotations import Detection, Detections, boxes_in
from executor.photo.inputs.depth import Depth, DepthSource
from executor.photo.inputs.picture import Exif, Intrinsics, Photograph, read_camera
from executor.photo.networks import depth as depth_networks
from executor.photo.networks import masks as mask_networks
from executor.photo.networks.depth import guessed_depth
from executor.photo.networks.detect import detector_in
from executor.photo.networks.folder import Network
from executor.photo.networks.masks import box_masks
from executor.photo.perception import FoundBox, to_detections
from executor.photo.pipeline import AuxiliaryInputs, PhotoInput, read_inputs
from tests.executor.photo.test_fit import BOWL, TABLE, seen_from_above
from tests.executor.photo.tiny_networks import (
    depth_pro,
    grounding_dino,
    sam2,
    sam2_video,
    sam3,
    sam3_tracker,
    sam3_video,
    zoedepth,
)

WIDTH, HEIGHT = 160, 120
NOISE = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
PICTURE = Photograph(Path("noise.png"), NOISE, Exif(None, None, ""))


@dataclass
class _Named:
    """A configuration or an answer: names with values."""

    values: dict[str, Any]

    def __getattr__(self, name: str) -> Any:
        return self.values[name]


def _recorded(folder: Path, processor: object, config: object, **answer: Any) -> Network:
    """Return a network that gives a recorded answer to any picture."""
    torch = pytest.importorskip("torch")

    class Model:
        def __init__(self) -> None:
            self.config = config

        def __call__(self, **inputs: Any) -> _Named:
            return _Named({key: torch.tensor(value, dtype=torch.float32) for key, value in answer.items()})

    return Network(Model(), processor, folder, torch, None)


class _Prepare:
    """Preprocessing whose result no recorded network looks at."""

    do_pad = True

    def __call__(self, images: np.ndarray, return_tensors: str, **size: object) -> dict[str, object]:
        return {"pixel_values": images}


def _folder(tmp_path: Path, kind: str) -> Path:
    (tmp_path / "config.json").write_text(json.dumps({"model_type": kind}))
    (tmp_path / "preprocessor_config.json").write_text("{}")
    (tmp_path / "model.safetensors").write_bytes(b"")
    return tmp_path


def _mug(box: Sequence[float]) -> Detection:
    x0, y0, x1, y1 = box
    return Detection("mug", "mug", (x0, y0, x1, y1), 0.9, "the test", provenance="detector")


# Masks


def _masks(
    monkeypatch: pytest.MonkeyPatch, folder: Path, logits: np.ndarray, things: Sequence[Detection]
) -> Detections:
    """Return things with the masks of recorded logits (N, h, w) of the whole picture."""
    config = _Named({"prompt_encoder_config": _Named({"image_size": 64})})
    network = _recorded(folder, _Prepare(), config, pred_masks=logits[None, :, None])
    monkeypatch.setattr(mask_networks, "loaded", lambda folder, kind: network)
    return box_masks(folder)(PICTURE, Detections(tuple(things)))


@settings(max_examples=20, deadline=None)
@given(x0=st.integers(0, 10), y0=st.integers(0, 8), across=st.integers(4, 9), down=st.integers(4, 9), data=st.data())
def test_a_mask_covers_the_pixels_that_the_network_marked(
    x0: int, y0: int, across: int, down: int, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    # Cells of a network's coarse answer: 20 x 20 of a picture of 160 x 120, so 8 x 6 pixels each.
    logits = np.full((1, 20, 20), -5.0)
    logits[0, y0 : y0 + down, x0 : x0 + across] = 5.0
    box = (8.0 * x0, 6.0 * y0, 8.0 * (x0 + across), 6.0 * (y0 + down))
    with pytest.MonkeyPatch.context() as patch:
        found = _masks(patch, _folder(tmp_path_factory.mktemp("sam"), "sam2"), logits, [_mug(box)])
    mask = found.things[0].mask
    assert mask is not None and mask.shape == (HEIGHT, WIDTH) and not found.doubts
    row, column = data.draw(st.integers(0, HEIGHT - 1)), data.draw(st.integers(0, WIDTH - 1))
    marked = y0 <= row // 6 < y0 + down and x0 <= column // 8 < x0 + across
    # Between the centres of two cells the answer is in between, so that an edge may be half a cell off.
    edge = (
        min(abs(row + 0.5 - 6 * y) for y in (y0, y0 + down)) < 3
        or min(abs(column + 0.5 - 8 * x) for x in (x0, x0 + across)) < 4
    )
    assert mask[row, column] == marked or edge


def test_a_mask_of_something_else_is_told_and_not_used(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    logits = np.full((2, 12, 16), -5.0)
    logits[0, 2:10, 3:8] = 5.0
    logits[1, 0:2, 0:2] = 5.0
    things = [_mug((30, 20, 80, 100)), _mug((90, 60, 150, 110))]
    found = _masks(monkeypatch, _folder(tmp_path, "sam2_video"), logits, things)
    assert found.things[0].mask is not None and found.things[1] == things[1] and found.things[1].mask is None
    assert found.doubts == (f"{tmp_path.name} has no mask for mug: its box is used",)


def test_a_mask_that_is_known_is_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    own = np.zeros((HEIGHT, WIDTH), bool)
    own[30:90, 40:70] = True
    thing = replace(_mug((40, 30, 70, 90)), mask=own)
    found = _masks(monkeypatch, _folder(tmp_path, "sam3_video"), np.zeros((0, 4, 4)), [thing])
    assert found.things[0].mask is own


def test_a_mask_is_what_is_fitted_and_what_a_scene_is_kept_for(tmp_path: Path) -> None:
    path, seen = _room(tmp_path)
    boxes = (tmp_path / "boxes.json").resolve()
    boxes.write_text(json.dumps({"things": [{"label": "table", "box": [0, 0, *seen.size_px]}]}))
    beside = AuxiliaryInputs(boxes_in(boxes, path.name), lambda picture, camera: Depth(seen.z_m, "exact"), _hfov(seen))
    plain = read_inputs(path, beside)
    marked = np.zeros(seen.z_m.shape, bool)
    marked[10:50, 10:60] = True

    def mask(picture: Photograph, found: Detections) -> Detections:
        return replace(found, things=tuple(replace(one, mask=marked) for one in found.things))

    masked = read_inputs(path, replace(beside, masks=mask))
    assert masked.detections[0].pixels(seen.size_px).sum() == 2000
    assert plain.sha256 != masked.sha256


# Depths


def _room(tmp_path: Path) -> tuple[Path, Any]:
    seen, _ = seen_from_above(TABLE, BOWL)
    Image.fromarray(seen.rgb).save(tmp_path / "room.png")
    return tmp_path / "room.png", seen


def _hfov(seen: Any) -> str:
    return f"hfov={math.degrees(2 * math.atan(seen.size_px[0] / 2 / seen.K.fx))}"


def _source(monkeypatch: pytest.MonkeyPatch, folder: Path, **answer: Any) -> DepthSource:
    network = _recorded(folder, _Prepare(), None, **answer)
    monkeypatch.setattr(depth_networks, "loaded", lambda folder, kind: network)
    return guessed_depth(folder)


@pytest.mark.parametrize("fx", [None, 100.0, 200.0])
def test_depth_pro_measures_with_the_opening_angle_that_is_known(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, fx: float | None
) -> None:
    source = _source(
        monkeypatch, _folder(tmp_path, "depth_pro"), predicted_depth=np.full((1, 8, 8), 0.5), field_of_view=[60.0]
    )
    camera = None if fx is None else Intrinsics(fx, fx, 80.0, 60.0, "known")
    found = source(PICTURE, camera)
    # Its answer is the inverse depth for a focal length of one picture's width.
    focal_px = fx or WIDTH / 2 / math.tan(math.radians(30.0))
    assert found.z_m == pytest.approx(np.full((HEIGHT, WIDTH), focal_px / WIDTH / 0.5))
    assert found.camera is not None and found.camera.fx == pytest.approx(focal_px, rel=1e-3)
    assert found.depth_distortion > 0.0 and found.source.startswith("guessed from the picture by")


@pytest.mark.parametrize("angle", [-4.0, 179.0])
def test_an_opening_angle_that_no_camera_has_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, angle: float
) -> None:
    answer = {"predicted_depth": np.ones((1, 8, 8)), "field_of_view": [angle]}
    with pytest.raises(PhotoRefused, match="no camera's; give --camera"):
        _source(monkeypatch, _folder(tmp_path, "depth_pro"), **answer)(PICTURE, None)


def test_zoedepth_loses_the_margin_that_it_reflects(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    beyond_x, beyond_y = (int(math.sqrt(side / 2) * 3) for side in (WIDTH, HEIGHT))
    columns, rows = np.meshgrid(np.arange(WIDTH + 2 * beyond_x), np.arange(HEIGHT + 2 * beyond_y))
    padded = 1.0 + 0.01 * (columns - beyond_x) + 0.001 * (rows - beyond_y)
    found = _source(monkeypatch, _folder(tmp_path, "zoedepth"), predicted_depth=padded[None])(PICTURE, None)
    assert found.camera is None
    assert found.z_m[0, 0] == pytest.approx(1.0) and found.z_m[-1, -1] == pytest.approx(1.0 + 1.59 + 0.119)


def _with(tmp_path: Path, depth: DepthSource, camera: str | None = None) -> PhotoInput:
    path, seen = _room(tmp_path)
    (tmp_path / "boxes.json").write_text(json.dumps({"things": [{"label": "table", "box": [0, 0, *seen.size_px]}]}))
    return read_inputs(path, AuxiliaryInputs(boxes_in(tmp_path / "boxes.json", path.name), depth, camera))


def test_a_camera_that_nothing_tells_is_the_networks(tmp_path: Path) -> None:
    _, seen = _room(tmp_path)
    asked: list[Intrinsics | None] = []

    def guess(picture: Photograph, camera: Intrinsics | None) -> Depth:
        asked.append(camera)
        known = camera or replace(read_camera(_hfov(seen), picture), source="guessed")
        return Depth(seen.z_m, "guessed", 0.02, known)

    assert _with(tmp_path, guess).camera.source == "guessed"
    assert _with(tmp_path, guess, _hfov(seen)).camera.source == _hfov(seen)
    assert asked[0] is None and asked[1] is not None
    with pytest.raises(PhotoRefused) as caught:
        _with(tmp_path, lambda picture, camera: Depth(seen.z_m, "measured"))
    assert caught.value.kind == "missing"


# Networks with random weights


@pytest.fixture(scope="module")
def transformers() -> Any:
    """The library, with one seed for all weights."""
    pytest.importorskip("torch").manual_seed(0)
    return pytest.importorskip("transformers")


@pytest.mark.slow
def test_depth_pro_runs_from_its_folder(transformers: Any, tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    network = depth_pro(transformers, tmp_path)
    found = guessed_depth(tmp_path)(PICTURE, None)
    # What the folder's preprocessing says, and what the network's authors do with its answer, once more.
    scaled = np.asarray(Image.fromarray(NOISE).resize((64, 64), Image.Resampling.BILINEAR)) / 255.0
    pixels = torch.tensor((scaled - [0.4, 0.5, 0.6]) / [0.2, 0.3, 0.4], dtype=torch.float32).permute(2, 0, 1)[None]
    with torch.inference_mode():
        answer = network(pixel_values=pixels)
    focal_px = 0.5 * WIDTH / torch.tan(0.5 * torch.deg2rad(answer.field_of_view[0]))
    inverse = (answer.predicted_depth * WIDTH / focal_px)[None]
    z_m = 1.0 / torch.nn.functional.interpolate(inverse, (HEIGHT, WIDTH), mode="bilinear")[0, 0].clamp(1e-4, 1e4)
    counted = (z_m.numpy() > 0.1) & (z_m.numpy() < 25.0)
    assert counted.any() and found.z_m[counted] == pytest.approx(z_m.numpy()[counted], rel=1e-2)
    assert found.camera is not None and found.camera.fx == pytest.approx(float(focal_px), rel=1e-3)


@pytest.mark.slow
def test_zoedepth_runs_from_its_folder(transformers: Any, tmp_path: Path) -> None:
    zoedepth(transformers, tmp_path)
    found = guessed_depth(tmp_path)(PICTURE, None)
    assert found.z_m.shape == (HEIGHT, WIDTH) and 0.1 < float(np.median(found.z_m)) < 10.0


@pytest.mark.slow
@pytest.mark.parametrize("write", [sam2, sam3_tracker])
def test_masks_are_those_of_the_network(transformers: Any, tmp_path: Path, write: Any) -> None:
    torch = pytest.importorskip("torch")
    network = write(transformers, tmp_path)
    box = (20.0, 30.0, 120.0, 100.0)
    (thing,) = box_masks(tmp_path)(PICTURE, Detections((_mug(box),))).things
    side = 64 if write is sam2 else 56
    scaled = np.asarray(Image.fromarray(NOISE).resize((side, side), Image.Resampling.BILINEAR)) / 255.0
    pixels = torch.tensor((scaled - [0.4, 0.5, 0.6]) / [0.2, 0.3, 0.4], dtype=torch.float32).permute(2, 0, 1)[None]
    asked = torch.tensor([[[box[0], box[1], box[2], box[3]]]]) * torch.tensor([side / WIDTH, side / HEIGHT] * 2)
    with torch.inference_mode():
        answer = network(pixel_values=pixels, input_boxes=asked, multimask_output=False)
    theirs = torch.nn.functional.interpolate(answer.pred_masks[0], (HEIGHT, WIDTH), mode="bilinear")[0, 0] > 0.0
    inside = np.zeros((HEIGHT, WIDTH), bool)
    inside[30:100, 20:120] = True
    wanted = theirs.numpy() & inside
    if thing.mask is None:
        around = Image.fromarray(wanted).getbbox()
        assert around is None or (around[2] - around[0]) * (around[3] - around[1]) < 0.5 * inside.sum()
    else:
        assert (thing.mask != wanted).mean() < 0.01


@pytest.mark.slow
def test_networks_load_from_the_video_models_that_are_published(transformers: Any, tmp_path: Path) -> None:
    sam2_video(transformers, tmp_path / "2")
    sam3_video(transformers, tmp_path / "3")
    assert [json.loads((tmp_path / one / "config.json").read_text())["model_type"] for one in "23"] == [
        "sam2_video",
        "sam3_video",
    ]
    for one in "23":
        # No weights are missing, or it would be refused.
        (thing,) = box_masks(tmp_path / one)(PICTURE, Detections((_mug((20, 30, 120, 100)),))).things
        assert thing.label == "mug"
    assert detector_in(tmp_path / "3", 0.0, ["cup"])(PICTURE).things[0].source == "sam3_video in 3"


@pytest.mark.slow
def test_preprocessing_that_is_not_all_written_is_refused(transformers: Any, tmp_path: Path) -> None:
    depth_pro(transformers, tmp_path)
    written = json.loads((tmp_path / "preprocessor_config.json").read_text())
    del written["image_mean"]
    (tmp_path / "preprocessor_config.json").write_text(json.dumps(written))
    with pytest.raises(PhotoRefused, match="does not have image_mean"):
        guessed_depth(tmp_path)(PICTURE, None)


@pytest.mark.slow
def test_sam3_finds_names_with_their_masks(transformers: Any, tmp_path: Path) -> None:
    sam3(transformers, tmp_path)
    found = detector_in(tmp_path, 0.0, ["cup", "table"])(PICTURE)
    assert found.things and {one.label for one in found.things} <= {"cup", "table"}
    assert all(one.mask is None or one.mask.shape == (HEIGHT, WIDTH) for one in found.things)
    assert detector_in(tmp_path, 1.1, ["cup"])(PICTURE).things == ()
    assert all(one.score <= 1.0 and one.provenance == "detector" for one in found.things)


@pytest.mark.slow
def test_mm_grounding_dino_looks_for_the_names_that_are_given(transformers: Any, tmp_path: Path) -> None:
    grounding_dino(transformers, tmp_path, mm=True)
    found = detector_in(tmp_path, 0.0, ["cup", "table"])(PICTURE)
    assert found.things and {one.label for one in found.things} <= {"cup", "table"}
    with pytest.raises(PhotoRefused, match="pieces of words, and the names are"):
        detector_in(tmp_path, 0.0, ["cup"] * 200)(PICTURE)


# Boxes that a person corrects


def test_masks_of_a_detector_are_kept_with_its_boxes() -> None:
    marked = np.zeros((HEIGHT, WIDTH), bool)
    marked[10:50, 10:60] = True
    empty = FoundBox("bowl", (80, 60, 120, 100), 0.8, mask=marked & False)
    mug, bowl = to_detections([FoundBox("mug", (10, 10, 60, 50), 0.9, mask=marked), empty], (WIDTH, HEIGHT), "x").things
    assert mug.mask is marked and bowl.mask is None


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--names", "mug"), "--detector or --model with it"),
        (("--names", "mug", "--boxes", "b.json"), "not --boxes"),
        (("--names", " , ", "--detector", "none"), "names with commas"),
        (("--mask-model", "none", "--boxes", "b.json"), "is no folder"),
        (("--mask-model", ".", "--boxes", "b.json"), "lacks config.json, weights in safetensors"),
    ],
)
def test_options_that_do_not_go_together_are_one_message(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    Image.fromarray(NOISE).save(tmp_path / "noise.png")
    (tmp_path / "b.json").write_text(json.dumps({"things": [{"label": "mug", "box": [10, 10, 60, 50]}]}))
    (tmp_path / "net").mkdir()
    typed = [str(tmp_path / {".": "net"}.get(one, one)) if one in (".", "none", "b.json") else one for one in words]
    command = ["photo", str(tmp_path / "noise.png"), "--camera", "hfov=60", "--out", str(tmp_path / "out")]
    assert run([*command, *typed]) == 2
    assert said in " ".join(capsys.readouterr().err.split())
