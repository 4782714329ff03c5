"""Which pictures of an attempt a model is shown, and how they are named to it.

Source: the paper's X_(k,j): per view the frames of the actions max(j - p_1, 1) to j, at most six an action.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from llm.evolution.observation import AttemptSeen
from llm.wire.transport import Image

_JPEG = b"\xff\xd8\xff"


@dataclass(frozen=True, slots=True)
class Picture:
    """One picture of a step.

    Attributes:
        step: Index of the step, from 0.
        primitive: Name of what was done.
        view: Which camera.
        image: The picture.
    """

    step: int
    primitive: str
    view: str
    image: Image


def window(step: int, look_back: int) -> range:
    """Returns the steps that are looked at to judge one: it, and as many before it as there are up to `look_back`."""
    return range(max(step - look_back, 0), step + 1)


def pictures_of(seen: AttemptSeen, steps: Iterable[int], views: Sequence[str], most: int) -> tuple[Picture, ...]:
    """Returns the pictures of some steps, in their order, view by view; evenly thinned out where there are too many.

    Each step and view keeps as many as the others, as far as it has them, its last one first.

    Args:
        seen: The attempt.
        steps: Indices of its steps.
        views: Which cameras; for none, nothing is drawn.
        most: Most pictures altogether.

    Raises:
        PicturesMissing: They cannot be drawn.
    """
    sequences = [
        [
            Picture(step, seen.steps[step].asked.primitive.name, view, Image(data, kind))
            for data in seen.steps[step].frames.get(view, ())
            for kind in ("image/jpeg" if data.startswith(_JPEG) else "image/png",)
        ]
        for step in steps
        for view in views
    ]
    longest = max(map(len, sequences), default=0)
    for length in range(longest, 0, -1):
        kept = [picture for sequence in sequences for picture in _thinned(sequence, length)]
        if len(kept) <= most:
            return tuple(kept)
    # Not even one of each sequence.
    return tuple(_thinned([sequence[-1] for sequence in sequences if sequence], most))


def _thinned(sequence: Sequence[Picture], count: int) -> Iterator[Picture]:
    """Yields at most so many pictures of a sequence, evenly spread; the last one is always among them."""
    if len(sequence) <= count:
        yield from sequence
    elif count == 1:
        yield sequence[-1]
    else:
        yield from (sequence[round(k * (len(sequence) - 1) / (count - 1))] for k in range(count))


def index_of(pictures: Sequence[Picture]) -> str:
    """Returns the lines that say which picture is which; without any, that there are none."""
    if not pictures:
        return "There are no pictures."
    order = "in this order; each sequence runs from the step's beginning to its end:"
    lines, first = [f"The pictures come with this message, {order}"], 1
    for (step, primitive, view), group in groupby(pictures, key=lambda p: (p.step, p.primitive, p.view)):
        last = first + len(list(group)) - 1
        numbers = f"picture {first}" if first == last else f"pictures {first} to {last}"
        lines.append(f"- {numbers}: step {step + 1} {primitive}, {view} view")
        first = last + 1
    return "\n".join(lines)


def hashes_of(pictures: Sequence[Picture]) -> list[dict[str, object]]:
    """Returns which pictures were looked at, for the record."""
    return [{"step": p.step, "view": p.view, "sha256": p.image.sha256} for p in pictures]
