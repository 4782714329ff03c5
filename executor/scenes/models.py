"""Choose the library's model and size for an object: by category and size, or by default where a file has none."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Collection, Mapping
from importlib import resources
from types import MappingProxyType

from bddl import near_names
from executor.assets.families.generic import GENERIC
from executor.assets.importers.store import PREFIX, stored_asset
from executor.assets.library import BUILT, FAMILIES, LIBRARY
from executor.assets.parameters import ModelEntry, Range
from oag import SceneObject
from oag.model.forms import ObjectForm
from oag.model.scene import FLOOR
from oag.model.symbols import Kind, has_rim, kind_of
from oag.sizes import PAPER_GRIPPER

Size = tuple[float, float, float]
_CATEGORIES = tomllib.loads((resources.files(__package__) / "data" / "categories.toml").read_text("utf-8"))
FLAT = frozenset(_CATEGORIES["flat"])
"""Categories that are left out."""

ABSURD = 3.0
"""A size so many times larger than the largest of its kind, or smaller than the smallest, is implausible."""

_UNITS_M = {"centimetres": 0.01, "millimetres": 0.001, "inches": 0.0254}


class NoMatchingModel(ValueError):
    """The library has no matching model, or the object is tilted; the message is half a sentence."""


def category_of(theirs: str) -> str:
    """Return the library's category for a category or a synset of BEHAVIOR.

    A `bottle_of_water` is a bottle, a `breakfast_table` a table: words after "of" are dropped, then the longest known
    ending decides.

    Raises:
        NoMatchingModel: There is none; the message suggests near ones.
    """
    exact = next((entry.category for entry in LIBRARY.values() if entry.synset == theirs), None)
    if exact is not None:
        return exact
    known = {entry.category: entry.category for entry in LIBRARY.values()} | dict(_CATEGORIES["alike"])
    words = theirs.lower().split(".", 1)[0].replace("__", "_").replace("-", "_").split("_")
    words = words[: words.index("of")] if "of" in words[1:] and theirs not in known else words
    for start in range(len(words)):
        name = "_".join(words[start:])
        if name in known:
            return known[name]
    near = near_names(words[-1], sorted(known))
    hint = f"; near it: {', '.join(near)}" if near else ""
    raise NoMatchingModel(f"the library has nothing of the category {theirs!r}{hint}")


def model_for(category: str, size_m: Size) -> ModelEntry:
    """Return the model of a category whose ranges are nearest to a size; the first one among equals."""
    return min(models_of(category), key=lambda entry: _misfit(entry, size_m))


def written_category(theirs: str, entry: ModelEntry) -> str:
    """Return the category for the scene: the original where it is more exact, else the model's."""
    own = theirs.endswith(f"_{entry.category}") and kind_of(theirs, 0.0) is kind_of(entry.category, 0.0)
    return theirs if own else entry.category


def shaped(entry: ModelEntry, size_m: Size) -> Size:
    """Return a size with the model's fixed proportions: a glass is round, an apple is a ball.

    Lengths without a fixed ratio stay, in or out of the range that the model is drawn from.
    """
    length, width, height = size_m
    if entry.length.of_width:
        width = (length + width) / 2 if entry.length.low == entry.length.high else min(length, width)
        length = entry.length.clipped(max(size_m[:2]), width)
    return (length, width, entry.height.clipped(height, width) if entry.height.of_width else height)


def _misfit(entry: ModelEntry, size_m: Size) -> float:
    """Distance of a size from a model's ranges: the sum over the axes of the logarithm of the ratio."""
    total = 0.0
    for value, span in zip(size_m, (entry.length, entry.width, entry.height), strict=True):
        total += abs(math.log(value / span.clipped(value, size_m[1])))
    return total


def implausible_size(size_m: Size, entries: Collection[ModelEntry]) -> str | None:
    """Describe a size far larger or smaller than that of all given models; return None for a plausible size.

    It catches slips of a decimal point or of a unit; a unit that makes the size usual is named.
    """
    low, high = _smallest_and_largest_m(entries)

    def is_like(unit_m: float) -> bool:
        sides = zip(size_m, low, high, strict=True)
        return all(least / ABSURD <= value * unit_m <= ABSURD * most for value, least, most in sides)

    if is_like(1.0):
        return None
    own, least, most = (" x ".join(f"{value:.3g}" for value in size) for size in (size_m, low, high))
    unit = next((f"; {name}?" for name, unit_m in _UNITS_M.items() if is_like(unit_m)), "")
    return f"is {own} m; its like are {least} to {most} m{unit}"


def _smallest_and_largest_m(entries: Collection[ModelEntry]) -> tuple[list[float], list[float]]:
    """Return the least and the largest x, y and z of models' ranges; x and y are treated alike, as sides."""
    low: list[list[float]] = []
    high: list[list[float]] = []
    for entry in entries:
        spans = (entry.length, entry.width, entry.height)
        low.append([span.low * (entry.width.low if span.of_width else 1.0) for span in spans])
        high.append([span.high * (entry.width.high if span.of_width else 1.0) for span in spans])
    least, most = [min(axis) for axis in zip(*low, strict=True)], [max(axis) for axis in zip(*high, strict=True)]
    return [min(least[:2])] * 2 + least[2:], [max(most[:2])] * 2 + most[2:]


def models_of(category: str) -> tuple[ModelEntry, ...]:
    """Return the library's models of one of its categories."""
    return tuple(entry for entry in LIBRARY.values() if entry.category == category)


MODELS: Mapping[str, str] = MappingProxyType(
    {
        "drawer": "cabinet_drawers",
        "drawers": "cabinet_drawers",
        "drawer_cabinet": "cabinet_drawers",
        "cabinet_with_drawers": "cabinet_drawers",
        "chest_of_drawers": "cabinet_drawers",
        "dresser": "cabinet_drawers",
        "round_table": "table_round",
        "nightstand_with_drawers": "nightstand",
    }
)
"""Categories more specific than the library's -> the model that they denote."""

_DIGITS = 3  # Default sizes are whole millimetres.


class NoDefaultSize(ValueError):
    """A value that a file leaves out has no default; the message has a remedy."""


def complete_object(key: str, form: ObjectForm) -> ObjectForm:
    """Return an object's form with its model and size; values in the form stay.

    Raises:
        NoDefaultSize: The library knows no such category or model, or it has no default size.
    """
    if form.category == FLOOR or (form.bbox_extent is not None and _is_built(form)):
        return form
    if form.model is not None and form.model.startswith(PREFIX):
        blank = SceneObject(key, form.category, form.model, (0, 0, 0), (1, 0, 0, 0), (1, 1, 1))
        return form.model_copy(update={"bbox_extent": stored_asset(blank).asset.extent_m})
    entry = _entry(form)
    size_m = form.bbox_extent or default_size_m(entry)
    least_m = min(size_m[:2])
    same_kind = kind_of(form.category, least_m) is kind_of(entry.category, least_m)
    category = form.category if same_kind and form.category not in LIBRARY else entry.category
    return form.model_copy(update={"category": category, "model": entry.model, "bbox_extent": size_m})


def default_size_m(entry: ModelEntry) -> Size:
    """Return a model's default size: the middle of its ranges, with items no wider than can be scaled to the hand."""
    width = _middle(entry.width)
    if kind_of(entry.category, width) is Kind.ITEM and not has_rim(entry.category):
        width = max(min(width, math.floor(PAPER_GRIPPER.widest_scaled_m * 10**_DIGITS) / 10**_DIGITS), entry.width.low)
    x, z = (_middle(span) * (width if span.of_width else 1.0) for span in (entry.length, entry.height))
    return (round(x, _DIGITS), width, round(z, _DIGITS))


def implausible_object_size(obj: SceneObject) -> str | None:
    """Describe an object's size if it is far larger or smaller than anything of its kind; return None otherwise.

    It catches slips of a decimal point or a unit. Imported assets, generic shapes and categories
    without a model may be of any size.
    """
    if obj.category == FLOOR or obj.model in GENERIC or obj.model.startswith(PREFIX):
        return None
    entries = (LIBRARY[obj.model],) if obj.model in LIBRARY else _entries_like(obj.category)
    if not entries:
        return None
    return implausible_size(obj.bbox_extent, entries)


def _entries_like(category: str) -> tuple[ModelEntry, ...]:
    """Return the library's models of a category or its synonyms; none without a match."""
    if category in MODELS:
        return (LIBRARY[MODELS[category]],)
    try:
        own = category_of(category)
    except NoMatchingModel:
        return ()
    return models_of(own)


def _middle(span: Range) -> float:
    return round((span.low + span.high) / 2, _DIGITS)


def _is_built(form: ObjectForm) -> bool:
    """Whether the model, or the last known word of the category, names a builder."""
    words = form.category.lower().split(".", 1)[0].replace("-", "_").split("_")
    return form.model in BUILT or (form.model or "").startswith(PREFIX) or any(word in FAMILIES for word in words)


def _entry(form: ObjectForm) -> ModelEntry:
    """Return the intended model: the one named, else the category's first one, or the nearest in size."""
    category = form.category
    # A model equal to the category is no model: scenes that were written back have the category there.
    own_model = form.model if form.model != category else None
    if own_model in GENERIC:
        raise NoDefaultSize(f"a {own_model} comes in no usual size; give bbox_extent, its x y z in metres")
    named = own_model or (category if category in LIBRARY else MODELS.get(category))
    if named is not None:
        if named not in LIBRARY:
            near = near_names(named, tuple(LIBRARY))
            hint = f"did you mean {' or '.join(near)}? " if near else ""
            raise NoDefaultSize(f"the library has no model {named!r}; {hint}`scene2demo assets` lists them")
        return LIBRARY[named]
    try:
        own = category_of(category)
    except NoMatchingModel as problem:
        if _is_built(form):
            raise NoDefaultSize(f"a {category} comes in no usual size; give bbox_extent, its x y z in metres") from None
        raise NoDefaultSize(f"{problem}; `scene2demo assets` lists what it has") from None
    first = next(entry for entry in LIBRARY.values() if entry.category == own)
    return first if form.bbox_extent is None else model_for(own, form.bbox_extent)
