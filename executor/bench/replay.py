"""One unit of a benchmark again: the same scene, task and seed, and whether the same states came of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from executor.bench.units import Unit
from executor.bench.version import outcome_version
from executor.bench.work import execute, prepare
from executor.evolution.record import Evolution
from executor.records.rollout import Rollout
from executor.scenes.pair import ScenePair
from oag import ObjectActionGraph


@dataclass(frozen=True, slots=True)
class Replayed:
    """A unit that was run again.

    Attributes:
        pair: Its scene and task.
        graph: The composed task.
        rollout: What happened this time.
        story: The revisions, where flows evolve.
        recorded: What the benchmark had kept of it.
    """

    pair: ScenePair
    graph: ObjectActionGraph
    rollout: Rollout
    story: Evolution | None
    recorded: Mapping[str, Any]

    @property
    def same(self) -> bool | None:
        """Whether the states are equal, to the last bit; None when the benchmark has no states to compare with."""
        recorded = self.recorded.get("state_hash")
        return None if recorded is None else bool(recorded == self.rollout.state_hash)

    @property
    def verdict(self) -> str:
        """The comparison in a sentence."""
        if self.same is None:
            return f"the unit {self.recorded['ended']} when it was measured, so there are no states to compare with"
        if self.same:
            return "the same states as when it was measured, to the last bit"
        why = "with the same program, so this kind of machine computes otherwise"
        if self.recorded.get("version") != outcome_version():
            why = "the program has changed since then"
        return f"OTHER states than when it was measured: {why}"


def replay(recorded: Mapping[str, Any]) -> Replayed:
    """Returns what comes of a unit when it is run again.

    Args:
        recorded: The unit's file.

    Raises:
        PlanRefused: The plan is not proved; nothing was moved then either.
    """
    unit = Unit.from_json(recorded)
    pair, graph = prepare(unit)
    done, story = execute(unit, pair, graph)
    return Replayed(pair, graph, done, story, recorded)
