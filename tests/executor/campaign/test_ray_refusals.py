"""Machines of a cluster that fail at their start, by a stand-in for Ray: they are refused, and the run ends."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from executor.campaign.ray_engine import RayEngine
from executor.system.workers import WorkersUnusable


class RayError(Exception):
    """An error of the stand-in."""


class StandIn:
    """A cluster of two machines, on which no actor starts."""

    exceptions = SimpleNamespace(RayError=RayError)

    def __init__(self) -> None:
        self.started = 0

    def is_initialized(self) -> bool:
        """Return that the driver has a cluster."""
        return True

    def nodes(self) -> list[dict[str, Any]]:
        """Return the machines."""
        return [{"NodeID": name, "Alive": True, "Resources": {"CPU": 4}} for name in ("one", "two")]

    def remote(self, _: object) -> Any:
        """Return a class of actors."""
        return SimpleNamespace(options=lambda **_: SimpleNamespace(remote=self._start))

    def _start(self, *_: object) -> Any:
        self.started += 1
        assert self.started < 5, "a machine that fails is started for ever"
        return SimpleNamespace(check=SimpleNamespace(remote=lambda *_, **__: object()))

    def wait(self, refs: list[object], timeout: float) -> tuple[list[object], list[object]]:
        """Return what is ready."""
        return refs[:1], refs[1:]

    def get(self, _: object) -> None:
        """Fail."""
        raise RayError("no such folder here")

    def kill(self, _: object) -> None:
        """End an actor."""


def test_a_run_ends_when_every_machine_fails_at_its_start(monkeypatch: pytest.MonkeyPatch) -> None:
    strategies = SimpleNamespace(NodeAffinitySchedulingStrategy=lambda name, soft: name)
    cluster = StandIn()
    monkeypatch.setattr(
        "executor.campaign.ray_engine.require", lambda name, _: cluster if name == "ray" else strategies
    )
    monkeypatch.setattr("executor.campaign.ray_engine._NODES_S", 0.0)
    engine = RayEngine("auto", "worker", 2, 60.0, version=lambda: "one")
    with pytest.raises(WorkersUnusable, match="it cannot start: no such folder here"):
        list(engine.run([{"number": 1}]))
    assert set(engine.refused) == {"one", "two"} and cluster.started == 2
