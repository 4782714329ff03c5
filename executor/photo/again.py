"""Reconstruct again from a folder of results, after people corrected a name, a size or a support in its `things.json`.

What was corrected, what stands on it, and what was not fitted before Ctrl-C is fitted; everything else stays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bddl import near_names
from executor.photo.errors import PhotoRefused
from executor.photo.fitting.hypothesis import Size, hypothesis_of
from executor.photo.fitting.likelihood import Fit, RatedHypothesis
from executor.photo.inputs.annotations import FLOOR, OWN_SUPPORTS, Detection, Detections, category_named, plain_name
from executor.photo.inputs.picture import Photograph
from executor.photo.output import SIZE_DIGITS, THINGS
from executor.scenes.models import NoMatchingModel
from executor.system.files import read_json

_FORM = 'expected the file that was written, with other values of "label", "on" (an id, floor or wall) or "size_m"'
_CORRECTED = "corrected by hand"


@dataclass(frozen=True)
class Earlier:
    """An earlier reconstruction with its corrections.

    Attributes:
        inputs: What was typed.
        detections: Boxes with names, supports and sizes as they are corrected.
        kept: index of a detection -> its fit, where nothing about it was corrected.
        given_sha256: Hash of the input as it was before any correction.
    """

    inputs: Mapping[str, Any]
    detections: tuple[Detection, ...]
    kept: Mapping[int, Fit] = field(repr=False)
    given_sha256: str

    def detect(self, picture: Photograph) -> Detections:
        """Return the detections, whatever the picture is."""
        return Detections(self.detections)


def read_earlier(folder: Path) -> Earlier:
    """Return the reconstruction of a folder, with what was corrected in its `things.json`.

    Raises:
        PhotoRefused: The folder lacks the files of a reconstruction, or they are malformed.
    """
    try:
        corrected, before = read_json(folder / THINGS), read_json(folder / "photo.json")
    except OSError as error:
        problem = f"has no reconstruction to go on from ({error.strerror or error})"
        raise PhotoRefused("again", folder, problem, "give the folder of an earlier `photo` or OUT/photo") from error
    except ValueError as error:
        raise PhotoRefused("again", folder / THINGS, f"is no JSON ({error})", _FORM) from error
    try:
        return _earlier(folder / THINGS, corrected, before)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        if isinstance(error, PhotoRefused):
            raise
        raise PhotoRefused("again", folder / THINGS, f"an entry is malformed ({error!r})", _FORM) from error


def _earlier(path: Path, corrected: Mapping[str, Any], before: Mapping[str, Any]) -> Earlier:
    entries: Sequence[Mapping[str, Any]] = corrected["things"]
    places = {entry["id"]: place for place, entry in enumerate(entries) if "id" in entry}
    detections, stale = [], set[int]()
    for place, entry in enumerate(entries):
        was = before["things"].get(entry.get("id"))
        detection = _detection(path, entry, was, places)
        detections.append(detection)
        if was is None or was["rough"] or _is_corrected(entry, was):
            stale.add(place)
    # What stands on a corrected thing is elsewhere.
    while more := {
        place
        for place, entry in enumerate(entries)
        if place not in stale and places.get(entry.get("on"), FLOOR) in stale
    }:
        stale |= more
    kept = {place: _fit(before["things"][entry["id"]]) for place, entry in enumerate(entries) if place not in stale}
    inputs = corrected["inputs"]
    if not isinstance(inputs, dict) or not isinstance(inputs.get("picture"), str):
        raise PhotoRefused("again", path, 'its "inputs" name no picture', 'expected {"picture": FILE, ...} as written')
    return Earlier(inputs, tuple(detections), kept, str(before["given_sha256"]))


def _is_corrected(entry: Mapping[str, Any], was: Mapping[str, Any]) -> bool:
    return entry["label"] != was["label"] or entry["on"] != was["stands_on"] or _is_resized(entry, was)


def _is_resized(entry: Mapping[str, Any], was: Mapping[str, Any]) -> bool:
    return list(entry["size_m"]) != [round(side, SIZE_DIGITS) for side in was["size_m"]]


def _detection(
    path: Path, entry: Mapping[str, Any], was: Mapping[str, Any] | None, places: Mapping[str, int]
) -> Detection:
    """Return an entry as a detection; what people corrected before is still given."""
    label = str(entry["label"])
    try:
        category = category_named(label)
    except NoMatchingModel:
        category = plain_name(label)
    x0, y0, x1, y1 = map(float, entry["box"])
    earlier = {} if was is None else was["given"]
    on = None if was is not None and entry["on"] == was["stands_on"] else entry.get("on")
    given_on = earlier.get("on") if on is None else on
    if given_on is not None and given_on not in OWN_SUPPORTS and given_on not in places:
        near = near_names(str(given_on), tuple(places)) or list(places)
        raise PhotoRefused(
            "again", path, f"{label} is on {given_on!r}, which is no id", f"expected floor, wall, {', '.join(near)}"
        )
    sized = was is not None and _is_resized(entry, was)
    size_m = entry["size_m"] if sized else earlier.get("size_m")
    renamed = was is None or label != was["label"]
    return Detection(
        label,
        category,
        (x0, y0, x1, y1),
        1.0 if was is None else float(was["score"]),
        _CORRECTED if renamed or was is None else str(was["label_source"]),
        doors=earlier.get("doors"),
        drawers=earlier.get("drawers"),
        on=None if given_on is None else {**places, **OWN_SUPPORTS}[given_on],
        provenance="person" if renamed or was is None else was["label_provenance"],
        size_m=None if size_m is None else _size(path, label, size_m),
    )


def _size(path: Path, label: str, size_m: Sequence[float]) -> Size:
    length, width, height = map(float, size_m)
    if not all(0.002 <= side <= 10.0 for side in (length, width, height)):
        raise PhotoRefused("again", path, f"{label} has the size {list(size_m)}", "expected three lengths in metres")
    return length, width, height


def _fit(was: Mapping[str, Any]) -> Fit:
    colour, residual_m = was["colour_srgb"], was["residual_m"]
    return Fit(
        hypothesis_of(was["fit"]),
        float(was["cost"]),
        tuple(
            RatedHypothesis(hypothesis_of(one["fit"]), float(was["cost"] + one["cost_more"]))
            for one in was["alternatives"]
        ),
        float(was["explained"]),
        float("inf") if residual_m is None else float(residual_m),
        int(was["pixels"]),
        None if colour is None else (colour[0], colour[1], colour[2]),
        (float(was["spread_m"]["place"]), float(was["spread_m"]["side"])),
        float(was["in_box"]),
        str(was["assumed"]),
    )
