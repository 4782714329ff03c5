"""Recordings give a picture with its depth and camera; known lengths and boards give depths their scale."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from executor.photo.errors import PhotoRefused
from executor.photo.geometry.level import find_board, read_length, scale_by_board, scale_by_length
from executor.photo.inputs.depth import Capture, Depth, read_capture, read_depth
from executor.photo.inputs.picture import Exif, Intrinsics, Photograph

SIZE = (160, 120)
BLACK = np.zeros((*SIZE[::-1], 3), np.uint8)
CAMERA = Intrinsics(200.0, 200.0, 80.0, 60.0, "drawn")
# As Record3D writes it: column by column, for the large picture.
SAID = {"w": 160, "h": 120, "K": [200.0, 0, 0, 0, 205.0, 0, 80.0, 60.0, 1]}


def tum(folder: Path, apart_s: float = 0.01) -> Path:
    """Return a folder as of TUM's first camera, with three moments at 1, 2 and 3 m."""
    path = folder / "rgbd_dataset_freiburg1_desk"
    for name in ("rgb", "depth"):
        (path / name).mkdir(parents=True)
    listed: dict[str, list[str]] = {"rgb": ["# color images"], "depth": ["# depth maps"]}
    for number in range(3):
        Image.new("RGB", SIZE, (40 * number, 90, 60)).save(path / "rgb" / f"{number}.png")
        depth = np.full(SIZE[::-1], 5000 * (number + 1), np.uint16)
        Image.fromarray(depth).save(path / "depth" / f"{number}.png")
        listed["rgb"].append(f"{100.0 + number:.4f} rgb/{number}.png")
        listed["depth"].append(f"{100.0 + number + apart_s:.4f} depth/{number}.png")
    for name, lines in listed.items():
        (path / f"{name}.txt").write_text("\n".join(lines))
    return path


def r3d(folder: Path) -> Path:
    """Return a Record3D file with one moment: depths of 2 m, a quarter as wide, the first of them not sure."""
    lzfse = pytest.importorskip("lzfse")
    Image.new("RGB", SIZE, (10, 90, 60)).save(folder / "0.jpg")
    depth = np.full((30, 40), 2.0, np.float32)
    sure = np.full((30, 40), 2, np.uint8)
    sure[0, 0] = 0
    with zipfile.ZipFile(folder / "room.r3d", "w") as archive:
        archive.writestr("metadata", json.dumps(SAID))
        archive.write(folder / "0.jpg", "rgbd/0.jpg")
        archive.writestr("rgbd/0.depth", lzfse.compress(depth.tobytes()))
        archive.writestr("rgbd/0.conf", lzfse.compress(sure.tobytes()))
    return folder / "room.r3d"


def exported(folder: Path) -> Path:
    """Return Record3D's export of EXR and pictures, of one moment with depths of 2 m."""
    openexr = pytest.importorskip("OpenEXR")
    path = folder / "EXR_RGBD"
    for name in ("rgb", "depth"):
        (path / name).mkdir(parents=True)
    Image.new("RGB", SIZE, (10, 90, 60)).save(path / "rgb" / "7.jpg")
    header = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}
    openexr.File(header, {"R": np.full((30, 40), 2.0, np.float32)}).write(str(path / "depth" / "7.exr"))
    (path / "metadata.json").write_text(json.dumps(SAID))
    return folder


def test_a_tum_folder_gives_the_moment_in_the_middle_or_the_one_asked_for(tmp_path: Path) -> None:
    found = read_capture(tum(tmp_path))
    assert found.depth.z_m[60, 80] == pytest.approx(2.0) and int(found.picture.rgb[0, 0, 0]) == 40
    assert found.camera is not None and found.camera.fx == 517.3 and found.camera.cx == pytest.approx(319.1)
    assert read_capture(tmp_path / "rgbd_dataset_freiburg1_desk", 2).depth.z_m[60, 80] == pytest.approx(3.0)


@pytest.mark.parametrize("made", [r3d, exported])
def test_record3d_gives_depths_as_large_as_the_picture_and_the_camera(
    tmp_path: Path, made: Callable[[Path], Path]
) -> None:
    found: Capture = read_capture(made(tmp_path))
    assert found.picture.size_px == SIZE and found.depth.z_m.shape == SIZE[::-1]
    assert found.depth.z_m[60, 80] == pytest.approx(2.0)
    assert found.camera is not None and (found.camera.fx, found.camera.fy, found.camera.cx) == (200.0, 205.0, 80.0)
    unsure = found.depth.z_m[:4, :4]
    assert (unsure == 0.0).all() == (made is r3d)


def test_depths_in_exr_are_metres(tmp_path: Path) -> None:
    path = exported(tmp_path) / "EXR_RGBD" / "depth" / "7.exr"
    assert read_depth(path, (40, 30)).z_m[5, 5] == pytest.approx(2.0)
    path.write_bytes(b"no EXR")
    with pytest.raises(PhotoRefused, match="cannot be read as EXR"):
        read_depth(path, (40, 30))


@pytest.mark.parametrize(
    ("channels", "side", "said"), [(1, 10**6, "1000000 x 1000000"), (8, 4000, "512 MB"), (1, 4000, "cannot be read as")]
)
def test_an_exr_file_that_says_more_than_it_has_is_not_unpacked(
    tmp_path: Path, channels: int, side: int, said: str
) -> None:
    openexr = pytest.importorskip("OpenEXR")
    header = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}
    values = {f"{number}.Z" if number else "Z": np.full((8, 8), 2.0, np.float32) for number in range(channels)}
    openexr.File(header, values).write(str(tmp_path / "depth.exr"))
    content = bytearray((tmp_path / "depth.exr").read_bytes())
    at = content.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    content[at + 8 : at + 16] = (side - 1).to_bytes(4, "little") * 2
    (tmp_path / "depth.exr").write_bytes(content)
    with pytest.raises(PhotoRefused) as caught:
        read_depth(tmp_path / "depth.exr", (8, 8))
    assert caught.value.kind == "depth" and said in str(caught.value)


def test_packed_depths_that_say_more_than_a_recording_has_are_not_unpacked(tmp_path: Path) -> None:
    lzfse = pytest.importorskip("lzfse")
    path = r3d(tmp_path)
    with zipfile.ZipFile(path) as archive:
        kept = {name: archive.read(name) for name in archive.namelist()}
    bomb = bytearray(lzfse.compress(bytes(4_000_000)))
    bomb[4:8] = (400_000_000).to_bytes(4, "little")
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in kept.items():
            archive.writestr(name, bytes(bomb) if name.endswith(".depth") else content)
    with pytest.raises(PhotoRefused, match="MB when it is unpacked"):
        read_capture(path)


def _apart(folder: Path) -> object:
    return read_capture(tum(folder, apart_s=0.4))


def _outside(folder: Path) -> object:
    path = tum(folder)
    (path / "rgb.txt").write_text("101.0 ../../secret.png")
    return read_capture(path)


@pytest.mark.parametrize(
    ("attempt", "words"),
    [
        (lambda f: read_capture(f), "no recording of a known form"),
        (lambda f: read_capture(tum(f), 3), "has 3 moments and no number 3; --frame 0 to 2"),
        (_apart, "no depth was measured within 0.02 s"),
        (_outside, "outside of it"),
        (lambda f: read_length("1,2,3=4"), "X0,Y0,X1,Y1=METRES"),
        (lambda f: read_length("1,2,3,4=0"), "0.01 to 20 m"),
        (lambda f: scale_by_length(drawn(2.0), CAMERA, read_length("10,10,400,10=1")), "outside the picture"),
        (lambda f: scale_by_length(drawn(2.0), CAMERA, read_length("10,10,12,10=9")), "times as deep"),
        (lambda f: find_board("7x5,0.04", picture(np.zeros((*SIZE[::-1], 3), np.uint8)), CAMERA), "is no board"),
        (
            lambda f: find_board("5x4,0.1,0.07", picture(np.zeros((*SIZE[::-1], 3), np.uint8)), CAMERA),
            "0 of its corners",
        ),
    ],
)
def test_what_gives_no_picture_or_no_scale_is_refused(
    tmp_path: Path, attempt: Callable[[Path], object], words: str
) -> None:
    with pytest.raises(PhotoRefused, match=words):
        attempt(tmp_path)


def drawn(z_m: float) -> Depth:
    """Return the depth of a plane across."""
    return Depth(np.full(SIZE[::-1], z_m), "drawn")


def picture(rgb: np.ndarray) -> Photograph:
    """Return pixels as a photograph."""
    return Photograph(Path("drawn.png"), rgb, Exif(None, None, ""))


def test_a_known_length_scales_what_is_seen() -> None:
    scaled = scale_by_length(drawn(2.0), CAMERA, read_length("20,60,120,60=1.1"))
    assert scaled.z_m[60, 80] == pytest.approx(2.2) and "by the known length" in scaled.source


def test_a_board_scales_what_is_seen() -> None:
    cv2 = pytest.importorskip("cv2")
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard((5, 4), 0.1, 0.07, dictionary)
    rgb = np.full((480, 640, 3), 255, np.uint8)
    # Squares of 60 pixels at a focal length of 600 are a metre away.
    rgb[100:340, 150:450] = board.generateImage((300, 240))[..., None]
    camera = Intrinsics(600.0, 600.0, 320.0, 240.0, "drawn")
    seen = find_board("5x4, 0.1, 0.07", picture(rgb), camera)
    assert len(seen.corners_m) == 12 and seen.corners_m[:, 2] == pytest.approx(1.0, abs=0.01)
    assert float(seen.normal @ [0.0, 0.0, -1.0]) > 0.99
    scaled = scale_by_board(Depth(np.full((480, 640), 0.9), "drawn"), seen)
    assert scaled.z_m[0, 0] == pytest.approx(1.0, abs=0.01) and "ChArUco" in scaled.source
