"""The scenes and phrasings that the tests of `llm` share."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from oag import Scene

HERE = Path(__file__).resolve().parent
GOLDEN = HERE.parent / "golden"
SCENES = {
    name: Scene.from_json(data) for name, data in json.loads((HERE / "scenes.json").read_text(encoding="utf-8")).items()
}


@dataclass(frozen=True, slots=True)
class Phrasing:
    """A query with what it should lead to: a goal G, or a refusal.

    `held_out` marks every third one, by its place in the file: they were not looked at while the grammar was written.
    """

    scene: str
    query: str
    held_out: bool
    goal: str | None = None
    refuse: str | None = None


PHRASINGS = tuple(Phrasing(**entry) for entry in json.loads((HERE / "phrasings.json").read_text(encoding="utf-8")))
