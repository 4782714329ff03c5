"""Networks out of a folder: their answers become things and depths, and a folder that is none ends in one message."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from executor.assets.library import LIBRARY
from executor.cli.app import run
from executor.photo.errors import PhotoRefused
from executor.photo.inputs.picture import Exif, Photograph
from executor.photo.networks.depth import guessed_depth
from executor.photo.networks.detect import detector_in, zero_shot
from executor.photo.perception import packaged
from tests.executor.photo.test_fit import BOWL, TABLE, seen_from_above
from tests.executor.photo.tiny_networks import coco_ssd, depth_anything, grounding_dino, owlv2

CUP, DINING_TABLE = 47, 67
NOISE = np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8)
PICTURE = Photograph(Path("noise.png"), NOISE, Exif(None, None, ""))


@pytest.fixture(scope="module")
def transformers() -> Any:
    """The library."""
    return pytest.importorskip("transformers")


@pytest.fixture(scope="module")
def weights(transformers: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders with a depth network, an OWLv2, and one whose depths have no unit."""
    folder = tmp_path_factory.mktemp("weights")
    pytest.importorskip("torch").manual_seed(0)
    depth_anything(transformers, folder / "depth")
    depth_anything(transformers, folder / "relative", metric=False)
    owlv2(transformers, folder / "owl")
    return folder


@pytest.mark.slow
def test_owlv2_finds_what_the_library_says_it_finds(weights: Path, transformers: Any) -> None:
    torch = pytest.importorskip("torch")
    found = zero_shot(weights / "owl", 0.0)(PICTURE)
    assert found.things and not found.left_out and all("owlv2 in owl" in one.source for one in found.things)
    # Its own reading of its answer is the witness.
    network = transformers.Owlv2ForObjectDetection.from_pretrained(weights / "owl")
    prepare = transformers.Owlv2ImageProcessorPil.from_pretrained(weights / "owl")
    words = transformers.AutoTokenizer.from_pretrained(weights / "owl")
    first = found.things[0].label
    asked = words([f"a photo of a {first}"], padding="max_length", max_length=16, truncation=True, return_tensors="pt")
    pixels = prepare(images=NOISE, return_tensors="pt")["pixel_values"]
    with torch.inference_mode():
        answer = network(pixel_values=pixels, input_ids=asked["input_ids"], attention_mask=asked["attention_mask"])
    (theirs,) = prepare.post_process_object_detection(answer, threshold=-1.0, target_sizes=[(120, 160)])
    boxes = np.clip(theirs["boxes"].numpy(), 0, [160, 120, 160, 120])
    assert np.abs(boxes - found.things[0].box_px).max(axis=1).min() < 0.01
    assert zero_shot(weights / "owl", 1.1)(PICTURE).things == ()


@pytest.mark.slow
def test_grounding_dino_finds_what_the_library_says_it_finds(transformers: Any, tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    network = grounding_dino(transformers, tmp_path)
    found = zero_shot(tmp_path, 0.0)(PICTURE)
    assert found.things and not found.left_out
    prepare = transformers.GroundingDinoImageProcessorPil.from_pretrained(tmp_path)
    words = transformers.AutoTokenizer.from_pretrained(tmp_path)
    names = sorted({entry.category.replace("_", " ") for entry in LIBRARY.values()})
    asked = words("".join(f"{name}. " for name in names), return_tensors="pt")
    with torch.inference_mode():
        answer = network(**prepare(images=NOISE, return_tensors="pt"), **asked)
    processor = transformers.GroundingDinoProcessor
    (theirs,) = processor.post_process_grounded_object_detection(
        _Decodes(), answer, asked["input_ids"], threshold=0.0, text_threshold=0.0, target_sizes=[(120, 160)]
    )
    boxes = np.clip(theirs["boxes"].numpy(), 0, [160, 120, 160, 120])
    for one in found.things:
        assert np.abs(boxes - one.box_px).max(axis=1).min() < 0.01


class _Decodes:
    """Stands for a processor of which only the boxes are wanted."""

    def batch_decode(self, listed: list[list[int]]) -> list[str]:
        return ["" for _ in listed]


@pytest.mark.slow
def test_depths_are_those_of_the_network_in_the_pictures_size(weights: Path) -> None:
    found = guessed_depth(weights / "depth")(PICTURE, None)
    assert found.z_m.shape == (120, 160) and found.source == "guessed from the picture by depth"
    assert found.z_m == pytest.approx(np.full((120, 160), 10.0), abs=1.0), "half of what it can say at most"


def _folder(weights: Path, tmp_path: Path, change: Callable[[Path], object]) -> Path:
    folder = tmp_path / "changed"
    folder.mkdir()
    for file in (weights / "depth").iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    change(folder)
    return folder


def _other_kind(folder: Path) -> None:
    config = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps(config | {"model_type": "bert"}))


def _deeper(folder: Path) -> None:
    config = json.loads((folder / "config.json").read_text())
    config["backbone_config"]["num_hidden_layers"] = 5
    (folder / "config.json").write_text(json.dumps(config))


CHANGES: dict[str, tuple[Callable[[Path], object], str]] = {
    "another network": (_other_kind, "of the kind 'bert'; expected depth_anything"),
    "no weights": (
        lambda f: (f / "model.safetensors").rename(f / "pytorch_model.bin"),
        "lacks weights in safetensors (model.safetensors); pytorch_model.bin can run code",
    ),
    "cut off": (lambda f: (f / "model.safetensors").write_bytes(b"x" * 999), "weights cannot be read"),
    "weights of another": (_deeper, "of the network's weights, such as"),
    "no configuration": (lambda f: (f / "config.json").unlink(), "lacks config.json; expected what"),
    "no preprocessing": (
        lambda f: (f / "preprocessor_config.json").unlink(),
        "lacks preprocessor_config.json; expected",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CHANGES)
def test_a_folder_that_cannot_be_used_says_why(weights: Path, tmp_path: Path, name: str) -> None:
    change, words = CHANGES[name]
    folder = _folder(weights, tmp_path, change)
    with pytest.raises(PhotoRefused) as caught:
        guessed_depth(folder)(PICTURE, None)
    assert caught.value.kind == "weights" and words in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.slow
def test_depths_without_a_unit_are_none(weights: Path) -> None:
    with pytest.raises(PhotoRefused, match="no unit"):
        guessed_depth(weights / "relative")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["depth", "nowhere"])
def test_a_folder_without_a_detector_says_what_is_expected(weights: Path, name: str) -> None:
    with pytest.raises(PhotoRefused, match=r"grounding-dino|expected one with") as caught:
        detector_in(weights / name)
    assert caught.value.kind == "weights"


def test_the_packaged_detector_sees_red_as_a_cup(tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    coco_ssd(tmp_path, CUP)
    red = np.zeros((240, 320, 3), np.uint8)
    red[..., 0] = 200
    (cup,) = detector_in(tmp_path)(Photograph(Path("red.png"), red, Exif(None, None, ""))).things
    assert (cup.category, cup.score) == ("cup", pytest.approx(1.0))
    assert cup.box_px == pytest.approx((64.0, 80.0, 256.0, 160.0), abs=0.1)
    assert packaged(tmp_path)(Photograph(Path("black.png"), red * 0, Exif(None, None, ""))).things == ()
    (tmp_path / "graph.pbtxt").write_text("no graph")
    with pytest.raises(PhotoRefused, match="cannot be read"):
        packaged(tmp_path)
    (tmp_path / "graph.pbtxt").unlink()
    with pytest.raises(PhotoRefused, match=r"0 texts"):
        packaged(tmp_path)


def test_the_command_line_takes_folders_and_refuses_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("cv2")
    coco_ssd(tmp_path / "ssd", CUP)
    Image.new("RGB", (160, 120)).save(tmp_path / "black.png")
    words = ["photo", str(tmp_path / "black.png"), "--camera", "hfov=60", "--out", str(tmp_path / "out")]
    ends = {
        ("--detector", "ssd", "--camera-height-m", "1.5"): "nothing in it was recognised",
        ("--detector", "none"): "is no folder",
        ("--depth-model", "ssd"): "lacks config.json, weights in safetensors",
        ("--detector", "ssd", "--names", "dining tabel"): "expected dining table",
        ("--detector", "ssd", "--boxes", "b.json"): "one of --boxes, --detector and --model",
        ("--depth-model", "ssd", "--depth", "d.png"): "one of --depth and --depth-model",
        ("--detector", "ssd", "--least-score", "7"): "0 to 1",
        ("--least-score", "0.5"): "--detector with it",
    }
    for more, said in ends.items():
        typed = [str(tmp_path / word) if word in ("ssd", "none") else word for word in more]
        assert run([*words, *typed]) == 2
        assert said in " ".join(capsys.readouterr().err.split()), more
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_what_a_network_finds_can_be_corrected_and_given_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The network has a known answer: what random weights name need not be anything that explains its pixels."""
    pytest.importorskip("cv2")
    coco_ssd(tmp_path / "ssd", DINING_TABLE)
    seen, _ = seen_from_above(TABLE, BOWL)
    red = np.zeros_like(seen.rgb)
    red[..., 0] = 200
    Image.fromarray(red).save(tmp_path / "room.png")
    np.save(tmp_path / "depth.npy", seen.z_m)
    K = [[seen.K.fx, 0.0, seen.K.cx], [0.0, seen.K.fy, seen.K.cy], [0.0, 0.0, 1.0]]
    (tmp_path / "camera.json").write_text(json.dumps({"K": K}))
    out = tmp_path / "out"
    command = ["photo", tmp_path / "room.png", "--camera", tmp_path / "camera.json", "--depth", tmp_path / "depth.npy"]
    words = [*map(str, command), "--out", str(out), "--json"]
    assert run([*words, "--detector", str(tmp_path / "ssd"), "--names", "dining table"]) in (0, 1)
    answer = json.loads(capsys.readouterr().out)
    (table,) = answer["things"].values()
    assert (table["label"], table["label_provenance"], table["mask_pixels"]) == ("dining table", "detector", None)
    assert answer["depth"]["guessed"] is False
    written = json.loads((out / "boxes.json").read_text())
    (thing,) = written["things"]
    assert thing["label"] == "dining table" and thing["box"] == table["box_px"]
    assert written["size_px"] == list(seen.size_px) and written["source"] == table["label_source"]
    # A person corrects the name, and gives the file back where it lies.
    corrected = json.dumps({**written, "things": [{**thing, "label": "desk"}]})
    (out / "boxes.json").write_text(corrected)
    assert run([*words, "--boxes", str(out / "boxes.json"), "--force"]) in (0, 1)
    (desk,) = json.loads(capsys.readouterr().out)["things"].values()
    assert (desk["label"], desk["label_provenance"]) == ("desk", "person")
    assert (out / "boxes.json").read_text() == corrected


@pytest.mark.slow
def test_a_network_that_guesses_no_room_is_refused(
    weights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Image.fromarray(NOISE).save(tmp_path / "noise.png")
    (tmp_path / "boxes.json").write_text(json.dumps({"things": [{"label": "mug", "box": [10, 10, 60, 50]}]}))
    words = ["photo", tmp_path / "noise.png", "--camera", "hfov=60", "--boxes", tmp_path / "boxes.json", "--json"]
    # Ten metres everywhere, as this network guesses, are no room.
    assert run([*map(str, words), "--out", str(tmp_path / "flat"), "--depth-model", str(weights / "depth")]) == 2
    assert "no floor is seen" in json.loads(capsys.readouterr().out)["error"]["message"]
