"""Default model and size of an object whose scene file leaves them out, taken from the library."""

from __future__ import annotations

from collections.abc import Mapping
from math import floor
from types import MappingProxyType

from bddl import near_names
from executor.assets.importers.store import PREFIX, stored_asset
from executor.assets.library import FAMILIES, LIBRARY
from executor.assets.parameters import ModelEntry, Range
from executor.scenes.reconstruction import NoMatchingModel, category_of, implausible_size, model_for, models_of
from oag import Kind, SceneObject, kind_of
from oag.model.forms import ObjectForm
from oag.model.scene import FLOOR
from oag.model.symbols import has_rim
from oag.sizes import PAPER_GRIPPER

Size = tuple[float, float, float]
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
        width = max(min(width, floor(PAPER_GRIPPER.widest_scaled_m * 10**_DIGITS) / 10**_DIGITS), entry.width.low)
    x, z = (_middle(span) * (width if span.of_width else 1.0) for span in (entry.length, entry.height))
    return (round(x, _DIGITS), width, round(z, _DIGITS))


def implausible_object_size(obj: SceneObject) -> str | None:
    """Describe an object's size if it is far larger or smaller than anything of its kind; return None otherwise.

    It catches slips of a decimal point or a unit. Imported assets and categories without a model may be of any size.
    """
    if obj.category == FLOOR or obj.model.startswith(PREFIX):
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
    return form.model in LIBRARY or (form.model or "").startswith(PREFIX) or any(word in FAMILIES for word in words)


def _entry(form: ObjectForm) -> ModelEntry:
    """Return the intended model: the one named, else the category's first one, or the nearest in size."""
    category = form.category
    # A model equal to the category is no model: scenes that were written back have the category there.
    own_model = form.model if form.model != category else None
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
