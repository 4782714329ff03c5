"""One run of T1, done step by step under observation, that several files look at."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from executor.records import Rollout, ignore
from executor.rollouts.rollout import Run, RunConditions
from executor.scenes import library
from executor.scenes.vary import vary
from executor.skills.session import Session
from tests.executor.helpers import PAPER_SCALES
from tests.executor.rollouts.tasks import t1


@dataclass
class Components:
    """Notes which kinds of components the scene has after every step, and what was held then."""

    kinds: set[str] = field(default_factory=set)
    held: list[str] = field(default_factory=list)

    def before(self, session: Session) -> None:
        """Look at nothing."""

    def after(self, session: Session) -> None:
        """Look at every entity of the scene."""
        for entity in session.world.sapien_scene.entities:
            self.kinds |= {type(component).__name__ for component in entity.components}
        if session.hand.held:
            self.held.append(session.hand.held)


@pytest.fixture(scope="session")
def watched() -> tuple[Rollout, Components]:
    """T1 run step by step under observation."""
    scene = vary(library.load("kitchen_t1").with_scales(PAPER_SCALES["kitchen_t1"]), 15000)
    run = Run(t1(), scene, 15000, ignore, RunConditions(50.0))
    components = Components()
    checkpoint = run.begin()
    for index in range(4):
        record, checkpoint = run.subtask(index, checkpoint, components)
        run.subtasks.append(record)
    run.close()
    return run.finish(), components


@pytest.fixture(scope="session")
def t1_rollout(watched: tuple[Rollout, Components]) -> Rollout:
    """What was recorded of it."""
    return watched[0]
