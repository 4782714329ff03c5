"""What a scene file leaves out of an object, taken from the library: which model it is, and how large."""

from __future__ import annotations

from collections.abc import Mapping
from math import floor
from types import MappingProxyType

from bddl import near_names
from executor.assets.imports.stored import PREFIX, stored_asset
from executor.assets.library import FAMILIES, LIBRARY
from executor.assets.parameters import ModelEntry, Range
from executor.scenes.cousins.likeness import Unlike, category_of, model_for, models_of, unlike_size
from oag import Kind, SceneObject, kind_of
from oag.model.categories import has_rim
from oag.model.scenefile import FLOOR
from oag.model.sceneform import ObjectForm
from oag.task.sizes import PAPER_GRIPPER

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
"""Categories that say more than that of the library, and the model that they mean."""

_DIGITS = 3  # Usual sizes are whole millimetres.


class NoUsual(ValueError):
    """What a file leaves out of an object has no usual value; the message says what to write."""


def completed(key: str, form: ObjectForm) -> ObjectForm:
    """Returns an object's form with its model and size; what the form says stays as it is.

    Raises:
        NoUsual: The library knows no such category or model, or it comes in no usual size.
    """
    if form.category == FLOOR or (form.bbox_extent is not None and _is_built(form)):
        return form
    if form.model is not None and form.model.startswith(PREFIX):
        blank = SceneObject(key, form.category, form.model, (0, 0, 0), (1, 0, 0, 0), (1, 1, 1))
        return form.model_copy(update={"bbox_extent": stored_asset(blank).asset.extent_m})
    entry = _entry(form)
    size_m = form.bbox_extent or usual_size_m(entry)
    least_m = min(size_m[:2])
    same_kind = kind_of(form.category, least_m) is kind_of(entry.category, least_m)
    category = form.category if same_kind and form.category not in LIBRARY else entry.category
    return form.model_copy(update={"category": category, "model": entry.model, "bbox_extent": size_m})


def usual_size_m(entry: ModelEntry) -> Size:
    """Returns a usual size of a model: the middle of its ranges, and no item wider than can be scaled to the hand."""
    width = _middle(entry.width)
    if kind_of(entry.category, width) is Kind.ITEM and not has_rim(entry.category):
        width = max(min(width, floor(PAPER_GRIPPER.widest_scaled_m * 10**_DIGITS) / 10**_DIGITS), entry.width.low)
    x, z = (_middle(span) * (width if span.of_width else 1.0) for span in (entry.length, entry.height))
    return (round(x, _DIGITS), width, round(z, _DIGITS))


def unlike_its_kind(obj: SceneObject) -> str | None:
    """Returns how an object is far larger or smaller than anything of its kind; None where it is not.

    A slip of a decimal point or a unit is meant. Imported assets and what the library does not draw may be of any size.
    """
    if obj.category == FLOOR or obj.model.startswith(PREFIX):
        return None
    entries = (LIBRARY[obj.model],) if obj.model in LIBRARY else _entries_like(obj.category)
    if not entries:
        return None
    return unlike_size(obj.bbox_extent, entries)


def _entries_like(category: str) -> tuple[ModelEntry, ...]:
    """Returns the library's models of a category, however it is called; none where it has nothing like it."""
    if category in MODELS:
        return (LIBRARY[MODELS[category]],)
    try:
        own = category_of(category)
    except Unlike:
        return ()
    return models_of(own)


def _middle(span: Range) -> float:
    return round((span.low + span.high) / 2, _DIGITS)


def _is_built(form: ObjectForm) -> bool:
    """Whether the model, or the last known word of the category, names a builder."""
    words = form.category.lower().split(".", 1)[0].replace("-", "_").split("_")
    return form.model in LIBRARY or (form.model or "").startswith(PREFIX) or any(word in FAMILIES for word in words)


def _entry(form: ObjectForm) -> ModelEntry:
    """Returns the model that is meant: the one named, else the category's first one, or the nearest in size."""
    category = form.category
    # A model that is called as the category is none: what is written back says the category in its place.
    own_model = form.model if form.model != category else None
    named = own_model or (category if category in LIBRARY else MODELS.get(category))
    if named is not None:
        if named not in LIBRARY:
            near = near_names(named, tuple(LIBRARY))
            hint = f"did you mean {' or '.join(near)}? " if near else ""
            raise NoUsual(f"the library has no model {named!r}; {hint}`scene2demo assets` lists them")
        return LIBRARY[named]
    try:
        own = category_of(category)
    except Unlike as problem:
        if _is_built(form):
            raise NoUsual(f"a {category} comes in no usual size; give bbox_extent, its x y z in metres") from None
        raise NoUsual(f"{problem}; `scene2demo assets` lists what it has") from None
    first = next(entry for entry in LIBRARY.values() if entry.category == own)
    return first if form.bbox_extent is None else model_for(own, form.bbox_extent)
