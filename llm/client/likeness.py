"""How a request differs from those of a recording: the nearest one, and a line for each field that differs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

MOST_LINES = 6
_CONTEXT = 30


def nearest(asked: Mapping[str, object], recorded: Iterable[Mapping[str, object]]) -> int | None:
    """Return the position of the recorded request that differs least, or None if there is none.

    A differing field counts by its differing share. So a request with one other word is nearer than another one of
    the same form. The earliest wins a tie.
    """
    leaves = _leaves(asked)
    distances = [_distance(leaves, _leaves(other)) for other in recorded]
    return distances.index(min(distances)) if distances else None


def differences(asked: Mapping[str, object], recorded: Mapping[str, object]) -> tuple[str, ...]:
    """Return a line for each of the first few fields in which two requests differ."""
    ours, theirs = _leaves(asked), _leaves(recorded)
    places = _unlike(ours, theirs)
    lines = [_line(place, ours.get(place), theirs.get(place)) for place in places[:MOST_LINES]]
    if len(places) > MOST_LINES:
        lines.append(f"and {len(places) - MOST_LINES} more")
    return tuple(lines)


def _leaves(record: object) -> dict[str, object]:
    found: dict[str, object] = {}
    waiting: list[tuple[str, object]] = [("", record)]
    while waiting:
        place, value = waiting.pop()
        if isinstance(value, Mapping) and "image" in value:
            found[place] = f"image {str(value['image'])[:12]}… ({value.get('bytes')} bytes)"
        elif isinstance(value, Mapping) and value:
            waiting += [(f"{place}.{name}" if place else str(name), item) for name, item in reversed([*value.items()])]
        elif isinstance(value, (list, tuple)) and value:
            waiting += [(f"{place}[{index}]", item) for index, item in reversed([*enumerate(value)])]
        else:
            found[place] = value
    return found


def _unlike(ours: Mapping[str, object], theirs: Mapping[str, object]) -> list[str]:
    missing = object()
    places = dict.fromkeys([*ours, *theirs])
    return [place for place in places if ours.get(place, missing) != theirs.get(place, missing)]


def _distance(ours: Mapping[str, object], theirs: Mapping[str, object]) -> float:
    """Sum over differing fields: 1, or for two texts the share that is in neither common head nor tail."""
    total = 0.0
    for place in _unlike(ours, theirs):
        one, other = ours.get(place), theirs.get(place)
        if not isinstance(one, str) or not isinstance(other, str):
            total += 1.0
            continue
        head = _shared(one, other)
        tail = _shared(one[head:][::-1], other[head:][::-1])
        total += 1.0 - (head + tail) / max(len(one), len(other))
    return total


def _shared(one: str, other: str) -> int:
    pairs = enumerate(zip(one, other, strict=False))
    return next((index for index, (a, b) in pairs if a != b), min(len(one), len(other)))


def _line(place: str, ours: object, theirs: object) -> str:
    if not isinstance(ours, str) or not isinstance(theirs, str) or max(len(ours), len(theirs)) < 2 * _CONTEXT:
        return f"{place}: recorded {theirs!r:.80}, asked {ours!r:.80}"
    start = _shared(theirs, ours)
    before = max(0, start - _CONTEXT)
    shown = [text[before : start + _CONTEXT] for text in (theirs, ours)]
    return f"{place}, from character {start}: recorded …{shown[0]!r}, asked …{shown[1]!r}"
