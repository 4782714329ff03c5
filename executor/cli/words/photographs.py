"""What can be typed to `photo` and `bench photo`, and to `run` where its scene is made of a photograph."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import tyro

from executor.cli.words.shared import CommonOptions, Maybe, ReplaceResults, ResultsFolder


@dataclass(frozen=True)
class PhotoInputs:
    """What is given beside a photograph."""

    boxes: Maybe[Path] = None
    """Beside a photograph: boxes with names; COCO, LabelMe or own JSON, or YOLO's .txt with classes.txt beside it."""
    depth: Maybe[Path] = None
    """Its depth, pixel by pixel: a 16-bit PNG in millimetres, .npy, .npz or .exr; a recording has its own."""
    camera: Maybe[str] = None
    """hfov=DEGREES, vfov=DEGREES or a JSON file with fx, fy, cx, cy or K; by default what the picture's EXIF says."""
    depth_unit_m: Maybe[float] = None
    """What one step of the depth's numbers is in metres, such as 0.0002 for the TUM sets."""
    frame: Maybe[int] = None
    """Which picture of a recording, counted from 0; by default the one in the middle."""
    length: Maybe[str] = None
    """X0,Y0,X1,Y1=METRES: two pixels and how far apart they are; scales depths, or without depth the floor."""
    board: Maybe[str] = None
    """COLUMNSxROWS,SQUARE_M,MARKER_M[,DICTIONARY]: a ChArUco board, for the same, on the floor without depth."""
    camera_height_m: Maybe[float] = None
    """Without depth: how high above the floor the camera was."""


@dataclass(frozen=True)
class BenchPhotoOptions(CommonOptions):
    """Measure how good reconstructions from photographs are, on rooms of households that are known.

    Rooms are drawn from a seed and seen by a camera with noisy depth. Their boxes stand for a detector: they are the
    simulator's own, 3 % off, 5 % missed and 5 % misnamed. Goes on where an earlier run with the same folder ended.
    """

    out: ResultsFolder
    rooms: int = 20
    """How many rooms, of 102 a seed."""
    seed: int = 0
    """Of the rooms, the cameras and the noise."""


@dataclass(frozen=True)
class PhotoOptions(CommonOptions):
    """Reconstruct a room from a photograph, best with depth, as a scene of the library's models.

    What is seen in each box is explained by a model that is posed, sized and opened until its depths and colours are
    those of the picture. Exit code 1 means that physics refuses what came out, 2 that what was given cannot be used.
    """

    picture: tyro.conf.Positional[Path]
    """The picture (PNG, JPEG or another usual form), or a recording: a TUM folder, Record3D's .r3d or EXR export."""
    out: ResultsFolder
    beside: PhotoInputs = field(default_factory=PhotoInputs)
    force: ReplaceResults = False
