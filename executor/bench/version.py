"""A hash of everything that decides how an episode ends: sources, data and the libraries that compute."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

from executor.machine.files import content_key

_PACKAGES = ("bddl", "oag", "llm", "executor")
# What only shows, draws, stores or counts.
_WITHOUT_A_SAY = (
    "executor/bench",
    "executor/cli",
    "executor/pictures",
    "executor/results",
    "executor/machine/workers",
)
# Of the benchmark, what makes the scene, the task and the flows has a say, and what prepares the process.
_WITH_A_SAY = (
    "executor/bench/data/initial_flows.json",
    "executor/bench/pairs.py",
    "executor/bench/paper.py",
    "executor/bench/work.py",
    "executor/bench/worker.py",
)
_LIBRARIES = ("sapien", "numpy", "scipy", "trimesh", "example-robot-data")


def outcome_version() -> str:
    """Returns 16 hexadecimal digits that change when a result of before may not be repeated exactly."""
    root = Path(__file__).resolve().parents[2]
    parts: list[bytes | str] = []
    for package in _PACKAGES:
        for path in sorted((root / package).rglob("*")):
            name = path.relative_to(root).as_posix()
            if path.is_file() and "__pycache__" not in name and _matters(name):
                parts += [name, path.read_bytes()]
    for library in _LIBRARIES:
        try:
            parts.append(f"{library} {metadata.version(library)}")
        except metadata.PackageNotFoundError:
            parts.append(f"{library} missing")
    return content_key(*parts)


def _matters(name: str) -> bool:
    return name in _WITH_A_SAY or not name.startswith(tuple(f"{folder}/" for folder in _WITHOUT_A_SAY))
