"""What a data set says of its demonstrations and its robot, as far as policies ask for it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from executor.datasets.formats.selection import NothingToExport
from executor.datasets.formats.stream import CORRECTION, DEMONSTRATION, FAILURE, EpisodeStream, FoldedEpisode
from executor.datasets.store import NotADataset
from executor.datasets.units import DemoUnit
from oag.model.scenefile import FULL_SCALE, PAPER_SCALE


@dataclass(frozen=True, slots=True)
class Told:
    """What is said of a demonstration that is asked for here.

    Attributes:
        id, name: Which it is, whatever it is kept in, and what people call it.
        unit: What it was generated of.
        takeover: Whether it goes on from where a policy had come to.
    """

    id: str
    name: str
    unit: DemoUnit
    takeover: bool


def demonstrations(path: Path, stream: EpisodeStream) -> Iterator[tuple[Told, FoldedEpisode]]:
    """Yields the demonstrations of a data set, and what is said of each.

    Raises:
        NothingToExport: There are none.
        NotADataset: Of one it is not said, or not as this program says it.
    """
    any_of_it = False
    for episode in stream.episodes():
        about = episode.about
        try:
            if (kind := about["kind"]) not in (DEMONSTRATION, CORRECTION, FAILURE):
                raise ValueError(f"kind is {kind!r}, expected {DEMONSTRATION!r}, {CORRECTION!r} or {FAILURE!r}")
            takeover = about.get("takeover")
            if takeover:
                int(takeover["subtask"])
            told = Told(str(about["id"]), str(about["name"]), DemoUnit.from_json(about["unit"]), bool(takeover))
        except (KeyError, TypeError, ValueError, AttributeError) as problem:
            raise _untold(path, f"of episode {episode.index}", problem) from None
        if kind == DEMONSTRATION:
            any_of_it = True
            yield told, episode
    if not any_of_it:
        raise NothingToExport(f"{path} has no demonstrations, and only these are learned from")


def robot_scale(path: Path, stream: EpisodeStream) -> float:
    """Returns the scale of a data set's robot, of a Panda's full size.

    Raises:
        NotADataset: It is not said, or is none that a robot has.
    """
    try:
        scale = float(stream.found.robot["scale"])
        if scale not in (PAPER_SCALE, FULL_SCALE):
            raise ValueError(f"scale is {scale:g}, expected {PAPER_SCALE:g} or {FULL_SCALE:g}")
    except (KeyError, TypeError, ValueError) as problem:
        raise _untold(path, "of the robot", problem) from None
    return scale


def _untold(path: Path, what: str, problem: Exception) -> NotADataset:
    if isinstance(problem, ValidationError):
        first = problem.errors()[0]
        words = f"{'.'.join(map(str, ('unit', *first['loc'])))}: {first['msg']}"
    else:
        words = f"it lacks {problem}" if isinstance(problem, KeyError) else str(problem)
    return NotADataset(
        f"{path} cannot be learned from: what it says {what} is not as it was written: {words}; "
        "export it anew, or copy all of it"
    )
