"""Labelled boxes: detections, and the annotation files that people and programs write.

Formats are COCO, LabelMe, YOLO and our own:
{"source": "who found them", "things": [{"label": "refrigerator", "box": [x0, y0, x1, y1], "score": 0.9}]}
with boxes in pixels from the upper left corner of the picture. "size_px": [width, height] next to "things" is the size
of
the image on which the boxes were drawn, if it is not the picture itself: [1000, 1000] for thousandths.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from bddl.files import read_bounded_text
from executor.assets.families.generic import GENERIC
from executor.assets.library import LIBRARY
from executor.assets.parameters import ModelEntry
from executor.photo.errors import PhotoRefused
from executor.photo.inputs.consistency import box_doubts
from executor.photo.inputs.picture import Photograph
from executor.scenes.models import NoMatchingModel, category_of, written_category
from llm.offline.lexicon import built_in
from oag.model.symbols import kind_of

LEAST_PX = 3.0
"""Of a box's sides."""

_OVER_PX = 2.0  # Tolerance of boxes over the picture's border, in percent of its side: rounding and jitter.
_PLAIN = re.compile("[a-z][a-z0-9_]*")  # Labels that can be categories, and begin names of things.
_NO_NAME = re.compile("[^a-z0-9]+")
Provenance: TypeAlias = Literal["person", "detector"]
"""Origin of a box and its label: a person, or a network or a model."""

_FORMS = "expected COCO, LabelMe or own JSON, or YOLO's .txt with classes.txt beside it"


@dataclass(frozen=True)
class Detection:
    """One detected object of the picture.

    Attributes:
        label: As it was written.
        category: The library's category, the label itself if the library has none, or None if the label has no meaning
            (`thing`, `unknown`).
        box_px: x0, y0, x1, y1 from the upper left corner, inside the picture.
        score: 0 to 1, the detector's confidence.
        source: Detector or annotator, for people.
        mask: (H, W) its own pixels, if they are known; the box is then around them.
        doors, drawers: Given numbers; None if unknown.
        on: Index of the given support among the detections; FLOOR or WALL, or None if unknown.
        provenance: Origin of box and label.
        size_m: Given length, width and height; None where they are fitted.
    """

    label: str
    category: str | None
    box_px: tuple[float, float, float, float]
    score: float
    source: str
    mask: NDArray[np.bool_] | None = field(default=None, compare=False, repr=False)
    doors: int | None = None
    drawers: int | None = None
    on: int | None = None
    provenance: Provenance = "person"
    size_m: tuple[float, float, float] | None = None

    @property
    def area_px(self) -> float:
        """Of its box."""
        x0, y0, x1, y1 = self.box_px
        return (x1 - x0) * (y1 - y0)

    def name_as(self, entry: ModelEntry, smaller_side_m: float = 0.0, labels: Iterable[str] = ()) -> str:
        """Return the category in a scene if it is fitted by a model: the label, if that is more specific.

        It is so unless the lexicon has it as another name of the category: a dresser is no cabinet for a query, and a
        wine glass no water glass. Of a book and a notebook in one picture, each keeps its own name.

        Args:
            entry: The model; a generic shape has no name of its own.
            smaller_side_m: Of the fit, which decides the kind of a category that is not known.
            labels: Those of the whole picture.
        """
        label = plain_name(self.label)
        if label is None:
            return entry.category
        if entry.model in GENERIC:
            return label
        known, own = (built_in().category_of(one) for one in (label, entry.category))
        words = label.split("_")
        names = () if own is None or known is not own else own.names
        # A wine glass is called a glass too, and says more than that.
        says_more = any(" ".join(words[start:]) in names for start in range(1, len(words)))
        others = {plain_name(one) for one in labels} - {label, None}
        tells_apart = known is not None and any(built_in().category_of(one) is known for one in others if one)
        is_synonym = " ".join(words) in names and not says_more and not tells_apart
        if not is_synonym and kind_of(label, smaller_side_m) is kind_of(entry.category, smaller_side_m):
            return label
        return written_category(label, entry)

    def pixels(self, size_px: tuple[int, int]) -> NDArray[np.bool_]:
        """Return (H, W) its own pixels; without a mask those of its box.

        Args:
            size_px: Width and height of the picture.
        """
        if self.mask is not None:
            return self.mask
        inside = np.zeros(size_px[::-1], dtype=bool)
        x0, y0, x1, y1 = (round(value) for value in self.box_px)
        inside[y0 : max(y1, y0 + 1), x0 : max(x1, x0 + 1)] = True
        return inside

    def to_json(self) -> dict[str, object]:
        """Return it as plain data, with the hash of the mask."""
        own = None if self.mask is None else hashlib.sha256(np.packbits(self.mask).tobytes()).hexdigest()
        return {
            "label": self.label,
            "category": self.category,
            "box_px": list(self.box_px),
            "score": self.score,
            "source": self.source,
            "mask": own,
            "doors": self.doors,
            "drawers": self.drawers,
            "on": self.on,
            "provenance": self.provenance,
            **({} if self.size_m is None else {"size_m": list(self.size_m)}),
        }


FLOOR, WALL = -1, -2
"""In place of the index of a support."""

OWN_SUPPORTS = {"floor": FLOOR, "wall": WALL}
"""What the room itself carries, by the names in files."""


@dataclass(frozen=True)
class LeftOut:
    """A detection for which the library has no model."""

    label: str
    box_px: tuple[float, float, float, float]
    reason: str


@dataclass(frozen=True)
class Detections:
    """The detections of a picture.

    Attributes:
        things: Detections that a scene can be made of.
        left_out: Other detections.
        doubts: Evidence against the boxes, as sentences.
    """

    things: tuple[Detection, ...]
    left_out: tuple[LeftOut, ...] = ()
    doubts: tuple[str, ...] = ()


Detector: TypeAlias = Callable[[Photograph], Detections]
"""Finds things in a picture; a file of boxes is one as well as a network. Raises PhotoRefused where it cannot."""


_Found = tuple[str, tuple[float, float, float, float], float]
_Size = tuple[float, float]
_SAME_SHAPE = 0.02
_ROOM = ("floor", "wall", "ceiling", "rug", "carpet")  # Not things: the room itself, and what lies flat on its floor.
_UNNAMED = ("", "thing", "object", "unknown", "?")


def boxes_in(path: Path, picture_name: str) -> Detector:
    """Return the detector that reads boxes from a file.

    Args:
        path: The file, see `read_boxes`.
        picture_name: Name of the picture's file.
    """

    def detect(picture: Photograph) -> Detections:
        """Raise PhotoRefused if the file is unusable, or only enlarged boxes end at edges."""
        things, drawn_on = _read(path, picture.size_px, picture_name)
        if drawn_on is None:
            doubts = box_doubts(path, [one.box_px for one in things], picture) if things else ()
        elif drawn_on != picture.size_px:
            sizes = [f"{width:g} x {height:g}" for width, height in (drawn_on, picture.size_px)]
            doubts = (f"{path.name}: its boxes were drawn on {sizes[0]} pixels, and are scaled to {sizes[1]}",)
        else:
            doubts = ()
        return Detections(things, doubts=doubts)

    return detect


def category_named(label: str) -> str | None:
    """Return the library's category for a label of people or models, None for a label without meaning.

    A `night table` is a nightstand: it is the lexicon's only category of that name.

    Raises:
        Unlike: The library has none; the message has near ones.
    """
    if label.lower() in _UNNAMED:
        return None
    written = _written(label)
    if all(entry.category != written for entry in LIBRARY.values()):
        spoken = written.replace("_", " ")
        lexicon = built_in()
        entries = {_category_or_none(key): one for key, one in lexicon.categories.items() if spoken in one.names}
        # A bin is a garbage can, and that is no can: the library's category has to be of the same entry.
        bearers = [name for name, entry in entries.items() if name is not None and lexicon.category_of(name) is entry]
        if len(bearers) == 1:
            return bearers[0]
    return category_of(written)


def is_left_out(label: str) -> bool:
    """Return whether a label is of the room itself, and so of no thing."""
    return label.lower() in _ROOM


def plain_name(label: str) -> str | None:
    """Return a label as a scene's category, `water_bottle` for "Water bottle"; None without a letter or a meaning."""
    written = _NO_NAME.sub("_", label.strip().lower()).strip("_")
    return written if _PLAIN.fullmatch(written) and written not in _UNNAMED else None


def _category_or_none(name: str) -> str | None:
    try:
        return category_of(name)
    except NoMatchingModel:
        return None


def _written(label: str) -> str:
    """Write a label as a category."""
    return label.strip().lower().replace(" ", "_")


def read_boxes(path: Path, size_px: tuple[int, int], picture_name: str = "") -> tuple[Detection, ...]:
    """Return the detections of an annotation file.

    Args:
        path: The file.
        size_px: Width and height of the picture.
        picture_name: Name of the picture's file, by which a COCO file of many pictures finds its boxes.

    Raises:
        PhotoRefused: The file cannot be read, or boxes are outside the picture.
        OSError: The file cannot be read.
    """
    return _read(path, size_px, picture_name)[0]


def _read(path: Path, size_px: tuple[int, int], picture_name: str) -> tuple[tuple[Detection, ...], _Size | None]:
    """Return the detections of a file, and the size of the image that its boxes were drawn on, if it has one."""
    try:
        text = read_bounded_text(path)
    except UnicodeDecodeError as error:
        raise PhotoRefused("boxes", path, "is no text in UTF-8", _FORMS) from error
    if path.suffix.lower() == ".txt":
        drawn_on: _Size | None = size_px
        found, source = list(_yolo(path, text, size_px)), "YOLO annotation"
    else:
        found, source, drawn_on = _of_json(path, text, size_px, picture_name)
    if not found:
        raise PhotoRefused("nothing", path, "has no box", "a scene needs at least one thing")
    across, down = (side / own for side, own in zip(size_px, drawn_on or size_px, strict=True))
    scaled = [
        (label, (x0 * across, y0 * down, x1 * across, y1 * down), score) for label, (x0, y0, x1, y1), score in found
    ]
    return _checked(path, scaled, source, size_px), drawn_on


def _checked(path: Path, found: Sequence[_Found], source: str, size_px: tuple[int, int]) -> tuple[Detection, ...]:
    width, height = size_px
    over_x, over_y = (_OVER_PX / 100 * side for side in size_px)
    outside, kept = [], []
    for number, (label, (x0, y0, x1, y1), score) in enumerate(found):
        shown = f"{label or 'thing'} {number} at {x0:g} {y0:g} {x1:g} {y1:g}"
        inside = -over_x <= x0 and -over_y <= y0 and x1 <= width + over_x and y1 <= height + over_y
        box = (max(0.0, x0), max(0.0, y0), min(float(width), x1), min(float(height), y1))
        if not (inside and box[2] - box[0] >= LEAST_PX and box[3] - box[1] >= LEAST_PX):
            outside.append(shown)
            continue
        if is_left_out(label):
            continue
        try:
            category = category_named(label)
        except NoMatchingModel:
            category = plain_name(label)
        kept.append(Detection(label, category, box, score, source))
    if outside:
        problem = f"{len(outside)} of {len(found)} boxes are not in the picture of {width} x {height} pixels"
        raise PhotoRefused("boxes", path, problem, f"the first: {outside[0]}; are they in another unit?")
    return tuple(kept)


def _of_json(
    path: Path, text: str, size_px: tuple[int, int], picture_name: str
) -> tuple[list[_Found], str, _Size | None]:
    """Return the boxes of a JSON file, their source, and the size of the image they were drawn on, if any."""
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise PhotoRefused("boxes", path, f"is no JSON ({error})", _FORMS) from error
    forms = {"things": _own, "annotations": _coco, "shapes": _labelme}
    key = next((key for key in forms if isinstance(data, Mapping) and isinstance(data.get(key), list)), None)
    if key is None:
        raise PhotoRefused("boxes", path, "has none of the lists things, annotations and shapes", _FORMS)
    if not all(isinstance(entry, Mapping) for entry in data[key]):
        raise PhotoRefused("boxes", path, f"an entry of {key} is no object", _FORMS)
    try:
        found = list(forms[key](data, picture_name))
        sides = {"things": _own_size, "annotations": _coco_size, "shapes": _labelme_size}[key](data, picture_name)
        drawn_on = _size(sides)
    except (TypeError, ValueError, KeyError, IndexError, AttributeError) as error:
        raise PhotoRefused("boxes", path, f"an entry of {key} is malformed ({error!r})", _FORMS) from error
    named = {"things": str(data.get("source", "own annotation")), "annotations": "COCO", "shapes": "LabelMe"}
    # In our own form thousandths are a size, too; the others have the size of a picture.
    if key != "things" and drawn_on is not None and not _is_shaped_alike(drawn_on, size_px):
        sizes = [f"{width:g} x {height:g}" for width, height in (drawn_on, size_px)]
        problem = f"its boxes are of a picture of {sizes[0]} pixels, and this one has {sizes[1]}"
        raise PhotoRefused(
            "boxes", path, problem, "give those of this picture, turned upright by its EXIF, and not cut"
        )
    return found, named[key], drawn_on


def _size(sides: Sequence[object] | None) -> _Size | None:
    """Return a width and a height, None if one is absent.

    Raises:
        ValueError: They are no sizes.
    """
    if sides is None or None in sides:
        return None
    width, height = (_finite(value) for value in sides)
    if min(width, height) <= 0.0:
        raise ValueError(f"{list(sides)!r} is no width and height")
    return width, height


def _is_shaped_alike(size: _Size, size_px: tuple[int, int]) -> bool:
    return abs(size[0] * size_px[1] - size[1] * size_px[0]) <= _SAME_SHAPE * size[1] * size_px[0]


def _own_size(data: Mapping[str, Any], picture_name: str) -> Sequence[object] | None:
    sides = data.get("size_px")
    return None if sides is None else list(sides)


def _coco_size(data: Mapping[str, Any], picture_name: str) -> Sequence[object] | None:
    images = data.get("images", [])
    image = next((one for one in images if Path(str(one.get("file_name", ""))).name == picture_name), None)
    image = images[0] if image is None and len(images) == 1 else image
    return None if image is None else (image.get("width") or None, image.get("height") or None)


def _labelme_size(data: Mapping[str, Any], picture_name: str) -> Sequence[object] | None:
    return data.get("imageWidth") or None, data.get("imageHeight") or None


def _own(data: Mapping[str, Any], picture_name: str) -> Iterator[_Found]:
    for entry in data["things"]:
        x0, y0, x1, y1 = (_finite(value) for value in entry["box"])
        yield str(entry.get("label", "")), (x0, y0, x1, y1), _finite(entry.get("score", 1.0))


def _coco(data: Mapping[str, Any], picture_name: str) -> Iterator[_Found]:
    names = {entry["id"]: str(entry["name"]) for entry in data["categories"]}
    images = {entry["id"]: str(entry.get("file_name", "")) for entry in data.get("images", [])}
    wanted = {key for key, name in images.items() if Path(name).name == picture_name} or set(images)
    if len(wanted) > 1:
        raise ValueError(f"boxes of {len(images)} pictures, none of them called {picture_name}")
    for entry in data["annotations"]:
        if not wanted or entry.get("image_id") in wanted:
            x, y, width, height = (_finite(value) for value in entry["bbox"])
            yield names[entry["category_id"]], (x, y, x + width, y + height), _finite(entry.get("score", 1.0))


def _labelme(data: Mapping[str, Any], picture_name: str) -> Iterator[_Found]:
    for entry in data["shapes"]:
        points = [(_finite(x), _finite(y)) for x, y in entry["points"]]
        across, down = [x for x, _ in points], [y for _, y in points]
        yield str(entry["label"]), (min(across), min(down), max(across), max(down)), 1.0


def _yolo(path: Path, text: str, size_px: tuple[int, int]) -> Iterator[_Found]:
    classes_path = path.with_name("classes.txt")
    if not classes_path.is_file():
        raise PhotoRefused("boxes", path, "there is no classes.txt beside it", "one label a line, the first is class 0")
    names = read_bounded_text(classes_path).splitlines()
    width, height = size_px
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            kind, x, y, wide, high, *rest = (_finite(float(word)) for word in line.split())
            label = names[int(kind)] if 0 <= kind < len(names) else None
        except ValueError as error:
            hint = "expected: class x y width height, in shares of the picture"
            raise PhotoRefused("boxes", path, f"line {number} is malformed ({error})", hint) from error
        if label is None:
            raise PhotoRefused("boxes", path, f"line {number} is of class {kind:g}, and classes.txt has {len(names)}")
        box = ((x - wide / 2) * width, (y - high / 2) * height, (x + wide / 2) * width, (y + high / 2) * height)
        yield label.strip(), box, rest[0] if rest else 1.0


def _finite(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{value!r} is no number")
    return float(value)
