"""What is usual of things by their names, from `usual.toml`; it decides where the picture leaves it open."""

from __future__ import annotations

import tomllib
from importlib import resources
from typing import Any

from executor.photo.inputs.annotations import plain_name
from oag.model.symbols import Kind, is_known, kind_of

_USUAL: dict[str, Any] = tomllib.loads((resources.files("executor.photo") / "data" / "usual.toml").read_text("utf-8"))
_NAMES = {key: frozenset(part["names"]) for key, part in _USUAL.items() if "names" in part}
_WALL, _WALL_DEEP_M = "wall", 0.10  # A `wall lamp` hangs by its first word; a `wall cabinet` is furniture.


def hung_depth_m(label: str) -> float | None:
    """Return how far a thing of a name usually stands out from its wall [m]; None where it does not usually hang."""
    words = _words(label)
    named: float | None = next((_USUAL["hangs"][one] for one in _endings(label) if one in _USUAL["hangs"]), None)
    if named is not None or _WALL not in words[:-1]:
        return named
    # The lexicon has a wall itself as furniture.
    rest = "_".join(word for word in words if word != _WALL)
    return None if is_known(rest) and kind_of(rest, 0.0) is not Kind.ITEM else _WALL_DEEP_M


def carries(label: str) -> bool:
    """Return whether things usually stand on an item of a name: on a tray, not on a keyboard."""
    return any(one in _NAMES["carriers"] for one in _endings(label))


def is_hollow(label: str) -> bool:
    """Return whether a thing of a name is open at the top."""
    return any(one in _NAMES["hollows"] for one in _endings(label))


def is_unlidded(label: str) -> bool:
    """Return whether a thing of a name, which may have a lid, mostly stands open at the top."""
    return any(one in _NAMES["unlidded"] for one in _endings(label))


def is_mostly_open(label: str) -> bool:
    """Return whether a thing of a name is open at the top where nothing shows that it is shut or upside down."""
    return is_unlidded(label) or any(one in _NAMES["turnable"] for one in _endings(label))


def is_folding(label: str) -> bool:
    """Return whether a thing of a name is a slab that opens into two, of which one stands up."""
    return any(one in _NAMES["folding"] for one in _endings(label))


def is_inset(label: str) -> bool:
    """Return whether a thing of a name is let into a top, as a sink is."""
    return any(one in _NAMES["inset"] for one in _endings(label))


def is_soft(label: str) -> bool:
    """Return whether a thing of a name is soft, and so usually on what people sit or lie on."""
    return any(one in _NAMES["soft"] for one in _endings(label))


def is_seat(label: str) -> bool:
    """Return whether a piece of furniture of a name is for one person to sit on: little else is usually on it."""
    return any(one in _NAMES["seats"] for one in _endings(label))


def is_lounge(label: str) -> bool:
    """Return whether people sit or lie on a piece of furniture of a name, several of them or lying."""
    return any(one in _NAMES["lounges"] for one in _endings(label))


def is_hot(label: str) -> bool:
    """Return whether a thing of a name becomes hot: little else than cookware is usually on it."""
    return any(one in _NAMES["hot"] for one in _endings(label))


def is_cookware(label: str) -> bool:
    """Return whether things of a name are usually put on what becomes hot."""
    return any(one in _NAMES["cookware"] for one in _endings(label))


def is_panel(label: str) -> bool:
    """Return whether a thing of a name is a panel on a stand, below which other things are seen."""
    return any(one in _NAMES["panels"] for one in _endings(label))


def is_usual_on_floor(label: str) -> bool:
    """Return whether an item of a name is as usual on the floor as on furniture."""
    return any(one in _NAMES["floored"] for one in _endings(label))


def is_open(label: str) -> bool:
    """Return whether a thing of a name has gaps in its outline, through which other things are seen."""
    return any(one in _NAMES["open"] for one in _endings(label))


def usual_length_m(label: str) -> float | None:
    """Return how long the longest side of a thing of a name usually is [m]; None where its name does not tell."""
    return next((_USUAL["long"][one] for one in _endings(label) if one in _USUAL["long"]), None)


def usual_thickness_m(label: str) -> float | None:
    """Return how thick a thing of a name usually is from front to back [m]; None where its name does not tell."""
    return next((_USUAL["thick"][one] for one in _endings(label) if one in _USUAL["thick"]), None)


def usual_height_m(label: str) -> float | None:
    """Return how high a thing of a name usually is where it lies [m]; None where its name does not tell."""
    return next((_USUAL["high"][one] for one in _endings(label) if one in _USUAL["high"]), None)


def _words(label: str) -> list[str]:
    return (plain_name(label) or "").split("_")


def _endings(label: str) -> list[str]:
    """Return the last two words of a name as one, and the last one, also without the endings of plurals.

    Of names whose last word means something else there, it is both words only.
    """
    words = _words(label)
    both, last = ([one, one.removesuffix("s"), one.removesuffix("es")] for one in ("_".join(words[-2:]), words[-1]))
    return both if not _NAMES["otherwise"].isdisjoint(both) else [*both, *last]
