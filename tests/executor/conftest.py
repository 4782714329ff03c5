"""Worlds for the executor's tests; every one is closed again, since a live scene can abort the interpreter's exit."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import pytest

from executor.sim.world import World
from oag import Scene
from tests.executor.helpers import MakeWorld, scene_at_paper_size

# For the renderer's driver. Tests take all cores already, and the processes that make data sets draw so too.
os.environ.setdefault("LP_NUM_THREADS", "1")


@pytest.fixture
def make_world() -> Iterator[MakeWorld]:
    """Make worlds from a scene or the name of one of the package's, and closes them after the test."""
    made: list[World] = []

    def make(scene: Scene | str, **options: Any) -> World:
        made.append(World(scene_at_paper_size(scene) if isinstance(scene, str) else scene, **options))
        return made[-1]

    yield make
    for world in made:
        world.close()


@pytest.fixture(scope="session", autouse=True)
def cache_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep generated files out of the user's own cache, and makes them anew once a session."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SCENE2DEMO_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield
