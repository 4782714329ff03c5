"""What is given with a photograph is read in all its forms; what cannot be used is refused with one message."""

from __future__ import annotations

import json
import math
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from executor.assets.library import LIBRARY
from executor.cli.app import run
from executor.photo.errors import PhotoRefused
from executor.photo.inputs.annotations import Detection, category_named, read_boxes
from executor.photo.inputs.depth import read_depth
from executor.photo.inputs.picture import MOST_BYTES, read_camera, read_picture

SIZE = (160, 120)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a picture, its depth of 2.5 m everywhere, and boxes in four forms."""
    Image.new("RGB", SIZE, (90, 120, 60)).save(tmp_path / "room.png")
    depth = np.full(SIZE[::-1], 2500, np.uint16)
    depth[0, 0] = 0
    Image.fromarray(depth).save(tmp_path / "depth.png")
    np.savez(tmp_path / "depth.npz", depth=depth / 1000.0)
    np.save(tmp_path / "depth.npy", depth)
    own = {"source": "me", "things": [{"label": "fridge", "box": [16, 12, 80, 60]}]}
    (tmp_path / "own.json").write_text(json.dumps(own))
    coco = {
        "images": [{"id": 1, "file_name": "other.png"}, {"id": 2, "file_name": "room.png"}],
        "categories": [{"id": 7, "name": "fridge"}, {"id": 8, "name": "cup"}],
        "annotations": [
            {"image_id": 1, "category_id": 8, "bbox": [1, 1, 9, 9]},
            {"image_id": 2, "category_id": 7, "bbox": [16, 12, 64, 48]},
        ],
    }
    (tmp_path / "coco.json").write_text(json.dumps(coco))
    points = [[16, 12], [80, 30], [40, 60]]
    (tmp_path / "labelme.json").write_text(json.dumps({"shapes": [{"label": "fridge", "points": points}]}))
    (tmp_path / "yolo.txt").write_text("1 0.3 0.3 0.4 0.4\n")
    (tmp_path / "classes.txt").write_text("cup\nfridge\n")
    return tmp_path


@pytest.mark.parametrize("name", ["own.json", "coco.json", "labelme.json", "yolo.txt"])
def test_boxes_are_the_same_in_every_form(folder: Path, name: str) -> None:
    (found,) = read_boxes(folder / name, SIZE, "room.png")
    assert found.category == "refrigerator" and found.label == "fridge"
    assert found.box_px == pytest.approx((16, 12, 80, 60))


@pytest.mark.parametrize(
    ("label", "category"),
    [
        ("fridge", "refrigerator"),
        ("Night table", "nightstand"),
        ("bedside_table", "nightstand"),
        ("coffee table", "coffee_table"),
        ("breakfast_table", "table"),
        ("closet", "wardrobe"),
        ("desk", "desk"),
        ("water bottle", "water_bottle"),
        ("work bench", "table"),
        ("thing", None),
    ],
)
def test_a_label_is_understood_as_a_query_is(label: str, category: str | None) -> None:
    assert category_named(label) == category


@pytest.mark.parametrize(
    ("label", "model", "name"),
    [
        ("dresser", "cabinet_drawers", "dresser"),
        ("Chest of drawers", "cabinet_drawers", "chest_of_drawers"),
        ("workbench", "table_four_legs", "workbench"),
        ("work_bench", "table_four_legs", "work_bench"),
        ("breakfast table", "table_round", "breakfast_table"),
        ("fridge", "fridge_one_door", "refrigerator"),
        ("night table", "nightstand", "nightstand"),
        ("wine glass", "tumbler", "wine_glass"),
        # What the lexicon has no other word for keeps a person's own word: only that will be said of it.
        ("leaflet", "book_lying", "leaflet"),
        ("kitchen/table", "table_round", "kitchen_table"),
        ("", "cup", "cup"),
    ],
)
def test_a_thing_keeps_the_name_that_it_was_given_where_that_says_more(label: str, model: str, name: str) -> None:
    assert Detection(label, LIBRARY[model].category, (0, 0, 9, 9), 1.0, "me").name_as(LIBRARY[model]) == name


def test_two_names_for_one_kind_stay_two_in_one_picture() -> None:
    book, notebook = (Detection(one, "book", (0, 0, 9, 9), 1.0, "me") for one in ("book", "notebook"))
    entry = LIBRARY["book_lying"]
    assert notebook.name_as(entry) == notebook.name_as(entry, 0.0, ["notebook", "Notebook", "mug"]) == "book"
    assert notebook.name_as(entry, 0.0, ["notebook", "book"]) == "notebook"
    assert book.name_as(entry, 0.0, ["notebook", "book"]) == "book"


@pytest.mark.parametrize("name", ["depth.png", "depth.npz", "depth.npy"])
def test_depth_is_the_same_in_every_form(folder: Path, name: str) -> None:
    found = read_depth(folder / name, SIZE)
    assert found.z_m[5, 5] == pytest.approx(2.5)
    assert name != "depth.png" or found.z_m[0, 0] == 0.0


@pytest.mark.parametrize("factor", [4, 3.75, 0.5])
def test_depth_of_fewer_or_more_pixels_is_scaled_within_surfaces_and_not_across_jumps(
    folder: Path, factor: float
) -> None:
    # A plane that recedes, and a box 0.5 m before its right half; one pixel has no depth.
    z_m = np.broadcast_to(1.0 / (0.5 - np.arange(96) / 400.0), (72, 96)).copy()
    z_m[:, 48:] -= 0.5
    z_m[9:12, 9:12] = 0.0
    np.save(folder / "low.npy", z_m.astype(np.float32))
    size = round(96 * factor), round(72 * factor)
    found = read_depth(folder / "low.npy", size)
    assert found.z_m.shape == size[::-1] and found.of_px == (96, 72) and "96 x 72" in found.source
    at = (np.arange(size[0]) + 0.5) / factor - 0.5
    right = 1.0 / (0.5 - at / 400.0) - np.where(np.arange(size[0]) >= size[0] // 2, 0.5, 0.0)
    row, middle = found.z_m[size[1] // 2], size[0] // 2
    for inner in (np.s_[round(2 * factor) : round(46 * factor)], np.s_[round(50 * factor) : round(94 * factor)]):
        assert row[inner] == pytest.approx(right[inner], abs=0.015 if factor > 1 else 0.03)
    assert abs(row[middle - 1] - row[middle]) > 0.4, "nothing is between the two"
    assert found.z_m[round(10.5 * factor), round(10.5 * factor)] == 0.0


def test_a_unit_of_depth_can_be_said(folder: Path) -> None:
    Image.fromarray(np.full(SIZE[::-1], 12500, np.uint16)).save(folder / "tum.png")
    assert read_depth(folder / "tum.png", SIZE, 1 / 5000).z_m.mean() == pytest.approx(2.5)


def test_the_camera_is_read_from_angles_files_and_exif(folder: Path) -> None:
    picture = read_picture(folder / "room.png")
    focal = SIZE[0] / 2 / math.tan(math.radians(35))
    assert read_camera("hfov=70", picture).fx == pytest.approx(focal)
    assert read_camera("vfov=55", picture).fy == pytest.approx(60 / math.tan(math.radians(27.5)))
    K = [[300, 0, 160], [0, 310, 120], [0, 0, 1]]
    (folder / "k.json").write_text(json.dumps({"K": K, "width": 320, "height": 240}))
    scaled = read_camera(str(folder / "k.json"), picture)
    assert (scaled.fx, scaled.fy, scaled.cx, scaled.cy) == pytest.approx((150, 155, 80, 60))
    assert read_camera(str(folder / "k.json"), picture).rays(SIZE)[59, 79] == pytest.approx([-0.5 / 150, -0.5 / 155, 1])
    found = read_camera(None, read_picture(photographed(folder, 36, SIZE)))
    assert found.fx == pytest.approx(36 / math.hypot(36, 24) * math.hypot(*SIZE)) and "EXIF" in found.source


def photographed(folder: Path, focal_35mm: int, size: tuple[int, int]) -> Path:
    """Write a picture whose EXIF says a focal length and a size."""
    image, path = Image.new("RGB", SIZE), folder / "phone.jpg"
    exif = image.getexif()
    exif.get_ifd(0x8769).update({0xA405: focal_35mm, 0xA002: size[0], 0xA003: size[1]})
    image.save(path, exif=exif)
    return path


Refused = Callable[[Path], object]


def _cut_off(folder: Path) -> object:
    noise = np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    Image.fromarray(noise).save(folder / "whole.png")
    (folder / "half.png").write_bytes((folder / "whole.png").read_bytes()[:20000])
    return read_picture(folder / "half.png")


def _huge(folder: Path) -> object:
    Image.new("1", (8000, 70)).save(folder / "huge.png")
    return read_picture(folder / "huge.png")


def _bomb(folder: Path, side: int) -> Path:
    """Write a PNG of so many black pixels a side, which packs to almost nothing."""
    rows = zlib.compress(bytes(side // 8 + 1) * 200)
    (folder / "bomb.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    with (folder / "bomb.png").open("ab") as file:
        for name, data in ((b"IHDR", struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)), (b"IDAT", rows)):
            file.write(struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)))
    return folder / "bomb.png"


def _npy(folder: Path, shape: tuple[int, ...], kind: str = "<f4", content: bytes = bytes(64)) -> Path:
    """Write an array with any header."""
    with (folder / "lying.npy").open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": kind, "fortran_order": False, "shape": shape})
        file.write(content)
    return folder / "lying.npy"


def _npz(folder: Path, *names: str, packed: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(folder / "lying.npz", "w", packed) as archive:
        for name in names:
            archive.writestr(f"{name}.npy", _npy(folder, (60000, 60000), content=bytes(5_000_000)).read_bytes())
    return folder / "lying.npz"


def _many(folder: Path) -> Path:
    with zipfile.ZipFile(folder / "many.npz", "w") as archive:
        for number in range(2000):
            archive.writestr(f"{number}.npy", b"")
    return folder / "many.npz"


def _too_large(folder: Path, name: str) -> Path:
    with (folder / name).open("wb") as file:
        file.truncate(MOST_BYTES + 1)
    return folder / name


def _boxes(folder: Path, label: str, box: list[float]) -> object:
    (folder / "b.json").write_text(json.dumps({"things": [{"label": label, "box": box}]}))
    return read_boxes(folder / "b.json", SIZE)


def _depth(folder: Path, value: float, kind: str) -> object:
    np.save(folder / "d.npy", np.full(SIZE[::-1], value, kind))
    return read_depth(folder / "d.npy", SIZE)


def _camera(folder: Path, given: str | None) -> object:
    return read_camera(given, read_picture(folder / "room.png"))


def _file(folder: Path, text: str) -> object:
    (folder / "k.json").write_text(text)
    return _camera(folder, str(folder / "k.json"))


def _pickled(folder: Path) -> object:
    np.savez(folder / "evil.npz", depth=np.array([{"a": 1}], dtype=object))
    return read_depth(folder / "evil.npz", SIZE)


REFUSED: dict[str, tuple[Refused, str, tuple[str, ...]]] = {
    "truncated": (_cut_off, "picture", ("cannot be read as a picture", "all of it")),
    "8000 pixels": (_huge, "picture", ("8000 x 70", "at most 4096", "scale it")),
    "900 megapixels": (lambda f: read_picture(_bomb(f, 30000)), "picture", ("over 80 megapixels", "at most 4096")),
    "100 megapixels": (lambda f: read_picture(_bomb(f, 10000)), "picture", ("over 80 megapixels", "at most 4096")),
    "25 megapixels": (lambda f: read_picture(_bomb(f, 5000)), "picture", ("5000 x 5000", "at most 4096")),
    "a large file": (lambda f: read_picture(_too_large(f, "p.png")), "picture", ("larger than 64 MB",)),
    "depth of 900 megapixels": (lambda f: read_depth(_bomb(f, 30000), SIZE), "depth", ("over 80 megapixels",)),
    "depth of another size": (lambda f: read_depth(_bomb(f, 4000), SIZE), "depth", ("4000 x 4000 pixels",)),
    "a large depth": (lambda f: read_depth(_too_large(f, "d.npz"), SIZE), "depth", ("larger than 64 MB",)),
    "endless array": (lambda f: read_depth(_npy(f, (10**9, 10**9)), SIZE), "depth", ("1000000000 x 1000000000",)),
    "array of less": (lambda f: read_depth(_npy(f, SIZE[::-1]), SIZE), "depth", ("76800 bytes", "it has 64")),
    "array of nothing": (lambda f: read_depth(_npy(f, (-1, 5)), SIZE), "depth", ("5 x -1",)),
    "array of text": (lambda f: read_depth(_npy(f, SIZE[::-1], "<U9"), SIZE), "depth", ("(120, 160) of <U9",)),
    "packed bomb": (lambda f: read_depth(_npz(f, "depth", "b"), SIZE), "depth", ("60000 x 60000",)),
    "two arrays": (lambda f: read_depth(_npz(f, "a", "b"), SIZE), "depth", ("holds a, b",)),
    "packed otherwise": (lambda f: read_depth(_npz(f, "a", packed=zipfile.ZIP_LZMA), SIZE), "depth", ("as NumPy",)),
    "many arrays": (lambda f: read_depth(_many(f), SIZE), "depth", ("very many arrays",)),
    "no picture": (lambda f: read_picture(f / "own.json"), "picture", ("cannot be read as a picture",)),
    "other shape": (lambda f: read_depth(f / "depth.png", (320, 200)), "depth", ("160 x 120", "registered")),
    "on its side": (lambda f: read_depth(f / "depth.png", (120, 160)), "depth", ("160 x 120", "turn it by 90")),
    "hardly any": (lambda f: read_depth(_npy(f, (24, 32), "<f4"), (640, 480)), "depth", ("32 x 24", "30 to 4096")),
    "metres as mm": (lambda f: _depth(f, 3, "uint16"), "depth", ("0.003 m", "in m it would be one", "--depth-unit-m")),
    "mm as metres": (lambda f: _depth(f, 2500.0, "float32"), "depth", ("2500 m", "in mm or TUM (1/5000 m)")),
    "nothing measured": (lambda f: _depth(f, np.nan, "float32"), "depth", ("only 0.0 %",)),
    "colours": (lambda f: read_depth(f / "room.png", SIZE), "depth", ("colours, not depths", "16-bit PNG")),
    "objects": (_pickled, "depth", ("cannot be read as an array",)),
    "box outside": (lambda f: _boxes(f, "cup", [300, 10, 400, 90]), "boxes", ("1 of 1 boxes", "160 x 120", "unit")),
    "box of nothing": (lambda f: _boxes(f, "cup", [10, 10, 10, 90]), "boxes", ("cup 0 at 10 10 10 90",)),
    "no boxes": (lambda f: read_boxes(f / "depth.png", SIZE), "boxes", ("no text",)),
    "classes": (lambda f: read_boxes(_alone(f), SIZE), "boxes", ("no classes.txt beside it",)),
    "no camera": (lambda f: _camera(f, None), "camera", ("does not say", "--camera", "hfov=DEGREES")),
    "absurd angle": (lambda f: _camera(f, "hfov=175"), "camera", ("1 to 170 degrees",)),
    "no angle": (lambda f: _camera(f, "fov=70"), "camera", ("neither an angle nor a JSON file",)),
    "no numbers": (lambda f: _file(f, '{"fx": "a", "fy": 1}'), "camera", ("fx, fy, cx, cy are not all there",)),
    "other picture": (
        lambda f: _file(f, '{"fx": 9, "fy": 9, "cx": 4, "cy": 4, "width": 90, "height": 90}'),
        "camera",
        ("picture of 90 x 90", "160 x 120"),
    ),
    "EXIF of an uncut picture": (
        lambda f: read_camera(None, read_picture(photographed(f, 28, (4000, 2000)))),
        "camera",
        ("4000 x 2000", "it was cut", "--camera"),
    ),
    "EXIF of a telescope": (
        lambda f: read_camera(None, read_picture(photographed(f, 3000, SIZE))),
        "camera",
        ("opening angle of 0.7 degrees", "15 to 130"),
    ),
}


def _alone(folder: Path) -> Path:
    (folder / "classes.txt").unlink()
    return folder / "yolo.txt"


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_used_is_refused(folder: Path, case: str) -> None:
    attempt, kind, words = REFUSED[case]
    with pytest.raises(PhotoRefused) as caught:
        attempt(folder)
    assert caught.value.kind == kind
    assert [word for word in words if word not in str(caught.value)] == []


def test_the_command_line_says_in_one_message_what_cannot_be_used(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    noise = np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    Image.fromarray(noise).save("noise.png")
    Path("half.png").write_bytes(Path("noise.png").read_bytes()[:20000])
    Path("letter.png").write_text("a letter")
    Image.new("1", (8000, 70)).save("huge.png")
    np.save("centimetres.npy", np.full(SIZE[::-1], 25000, np.uint16))
    np.save("small.npy", np.full((10, 10), 2.5))
    below = np.maximum(np.arange(120) - 59.5, 1e-3)  # A floor 1.4 m under a camera that looks straight ahead.
    depth_m = np.where(below > 30.0, 1.4 * 138.6 / below, 0.0)
    np.save("floor.npy", np.tile(depth_m[:, None], (1, 160)))
    photographed(folder, 28, (4000, 2000))
    Path("outside.json").write_text(json.dumps({"things": [{"label": "cup", "box": [300, 10, 400, 90]}]}))
    camera = ("--camera", "hfov=60")
    ends = {
        ("noise.png", "--depth", "depth.npy", "--boxes", "own.json", *camera): "no floor is seen in it",
        ("noise.png", "--depth", "small.npy", "--boxes", "own.json", *camera): "10 x 10 pixels, the picture 160 x 120",
        ("noise.png", "--depth", "centimetres.npy", "--boxes", "own.json", *camera): "--depth-unit-m",
        ("noise.png", "--depth", "floor.npy", "--boxes", "outside.json", *camera): "not in the picture of 160 x 120",
        ("phone.jpg", "--depth", "depth.npy", "--boxes", "own.json"): "it was cut",
        ("huge.png", "--depth", "depth.npy", "--boxes", "own.json", *camera): "at most 4096",
        ("half.png", "--depth", "depth.npy", "--boxes", "own.json", *camera): "truncated",
        ("letter.png", "--boxes", "own.json", *camera): "no known format",
        ("noise.png", "--depth", "letter.png", "--boxes", "own.json", *camera): "no known format",
        ("noise.png", "--boxes", "own.json", "--camera-height-m", "nan", *camera): "metres from 0.05 to 3",
        ("noise.png", "--boxes", "own.json", "--tilt", "95", *camera): "degrees from -45 to 90",
        ("noise.png", *camera): "3 things are missing",
    }
    for words, said in ends.items():
        assert run(["photo", *words, "--out", "out"]) == 2
        told = " ".join(capsys.readouterr().err.split())
        assert told.startswith("scene2demo: ") and said in told and "0x" not in told, told
    assert not list(folder.glob("out/*"))
