"""The scenes and tasks that tables of goals and states of repair name."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import oag
from executor.scenes.file import complete_scene, load_scene
from tests.oag.other_tasks import OTHERS

DATA = Path(__file__).parents[1] / "data"


def scene_named(name: str) -> oag.Scene:
    """The scene of a table's entry."""
    if name in OTHERS:
        return oag.Scene.from_json(OTHERS[name][0])
    if name == "own_kitchen":
        completed = complete_scene(import_module("examples.04_own_scene").SCENE)
        assert completed.scene is not None
        return completed.scene
    if name.isdigit():
        return load_scene(next((DATA / "scenes").glob(f"{name}_*.json")))
    file = DATA / f"{name}_scene.json"
    return oag.Scene.from_json(file) if file.exists() else load_scene(name)


def task_named(name: str) -> oag.Task:
    """The task of a table's entry, with its scene."""
    return oag.Task.from_json(OTHERS[name][1] if name in OTHERS else DATA / f"{name}.json", scene=scene_named(name))


def table(file: str, kind: str) -> list[Mapping[str, Any]]:
    """The entries of a table of goals or of states."""
    rows: list[Mapping[str, Any]] = tomllib.loads((DATA / "planning" / file).read_text(encoding="utf-8"))[kind]
    return rows
