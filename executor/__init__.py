"""Everything that moves: scenes, the robot, physics, cameras, recordings, and the command line.

The names below are imported when they are first used, so that `import executor` loads neither simulator nor torch.
"""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from executor.datasets.store import EpisodeStore
    from executor.evolution.evolve import evolve
    from executor.evolution.record import Evolution
    from executor.pictures.frames import Frames
    from executor.pictures.video import write_video
    from executor.records.rollout import Failure, FailureKind, MissingFlow, PlanRefused, Rollout, RolloutInterrupted
    from executor.results.episode import Episode
    from executor.results.robomimic import write_robomimic
    from executor.rollouts.repeat import repeat
    from executor.rollouts.running import resume, rollout
    from executor.scenes.library import names as scene_names
    from executor.scenes.reading import load_scene
    from executor.scenes.vary import vary

__all__ = [
    "Episode",
    "EpisodeStore",
    "Evolution",
    "Failure",
    "FailureKind",
    "Frames",
    "MissingFlow",
    "PlanRefused",
    "Rollout",
    "RolloutInterrupted",
    "evolve",
    "load_scene",
    "repeat",
    "resume",
    "rollout",
    "scene_names",
    "vary",
    "write_robomimic",
    "write_video",
]

_PLACES = {
    "Episode": ("executor.results.episode", "Episode"),
    "EpisodeStore": ("executor.datasets.store", "EpisodeStore"),
    "Evolution": ("executor.evolution.record", "Evolution"),
    "Failure": ("executor.records.rollout", "Failure"),
    "FailureKind": ("executor.records.rollout", "FailureKind"),
    "Frames": ("executor.pictures.frames", "Frames"),
    "MissingFlow": ("executor.records.rollout", "MissingFlow"),
    "PlanRefused": ("executor.records.rollout", "PlanRefused"),
    "Rollout": ("executor.records.rollout", "Rollout"),
    "RolloutInterrupted": ("executor.records.rollout", "RolloutInterrupted"),
    "evolve": ("executor.evolution.evolve", "evolve"),
    "load_scene": ("executor.scenes.reading", "load_scene"),
    "repeat": ("executor.rollouts.repeat", "repeat"),
    "resume": ("executor.rollouts.running", "resume"),
    "rollout": ("executor.rollouts.running", "rollout"),
    "scene_names": ("executor.scenes.library", "names"),
    "vary": ("executor.scenes.vary", "vary"),
    "write_robomimic": ("executor.results.robomimic", "write_robomimic"),
    "write_video": ("executor.pictures.video", "write_video"),
}


def require_own_packages() -> None:
    """Raises ImportError where `bddl`, `oag` or `llm` is another package, such as one in the folder of the start."""
    home = Path(__file__).resolve().parents[1]
    for name in ("bddl", "oag", "llm"):
        spec = importlib.util.find_spec(name)
        place = None if spec is None or spec.origin is None else Path(spec.origin).resolve().parent
        if place != home / name:
            raise ImportError(
                f"executor needs this project's own `{name}` package, but Python finds another one: {place or 'none'}; "
                "start from a folder without it, or install scene2demo in an environment of its own"
            )


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'executor' has no attribute {name!r}")
    require_own_packages()
    module, attribute = _PLACES[name]
    value = getattr(importlib.import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
