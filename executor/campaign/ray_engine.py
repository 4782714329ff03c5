"""Run requests on the machines of a Ray cluster: one actor a machine, which runs the pool of worker processes there.

Ray carries a request out and an outcome back, a kilobyte each; results are files of the shared folder. The driver gives
a request of a lost machine to another one. A machine whose program is of another version, or that has nothing to draw
with where pictures are wanted, gets no work. Machines that join later are taken up.

    ray start --head && scene2demo generate plan.yaml --out /shared/demos --ray auto
"""

from __future__ import annotations

import os
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from executor.campaign.engine import THREADS
from executor.system.extras import require
from executor.system.vulkan import find_renderer
from executor.system.workers import START_LIMIT_S, WorkerOutcome, WorkerPool, WorkersUnusable

MOST_TRIES = 3
"""Machines that may be lost under a request until it counts as crashed."""

_LOOK_S = 1.0
_NODES_S = 5.0


class NodePool:
    """The pool of one machine; an actor of Ray, whose methods are called from the driver.

    Args:
        module: Module of the worker process.
        workers: Number of processes.
        limit_s: Maximum wall time of a request [s].
        folder: Folder that relative paths of requests begin in, on every machine.
    """

    def __init__(self, module: str, workers: int, limit_s: float, folder: str) -> None:
        os.chdir(folder)
        self._pool = WorkerPool(module, workers, limit_s=limit_s, environment=THREADS)

    def check(self, version: Callable[[], str], *, renders: bool) -> tuple[str, str]:
        """Return the version of this machine's program, and why it cannot draw where it has to."""
        renderer = find_renderer() if renders else True
        return version(), "" if renderer else str(getattr(renderer, "why", "it has no renderer"))

    def ask(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Return the outcome of a request as plain data; what ends the whole run is data, too."""
        try:
            outcome = self._pool.ask(request)
        except WorkersUnusable as problem:
            return {"unusable": str(problem)}
        except OSError as problem:
            return {"no_room": [problem.errno, problem.strerror, problem.filename]}
        return {name: value for name, value in asdict(outcome).items() if name != "request"}


@dataclass
class _RayNode:
    """A machine at work.

    Attributes:
        actor: Its pool.
        room: How many requests it takes at once.
        checked: Whether its version is known to be right.
        flying: Reference -> its request and when it was handed over.
    """

    actor: Any
    room: int
    check: Any
    checked: bool = False
    flying: dict[Any, tuple[Mapping[str, Any], float]] = field(default_factory=dict)


class RayEngine:
    """The machines of a Ray cluster.

    Args:
        address: Address of the cluster, such as "auto" or "10.0.0.1:6379".
        module: Module of the worker process.
        workers: Largest number of processes a machine; it never has more than the machine offers CPUs.
        limit_s: Maximum wall time of a request [s].
        version: Returns the version of the program; called here and on every machine.
        renders: Whether machines have to be able to draw.

    Attributes:
        refused: Machine -> why it gets no work.
        lost: Number of machines that were lost.
    """

    def __init__(
        self,
        address: str,
        module: str,
        workers: int,
        limit_s: float,
        *,
        version: Callable[[], str],
        renders: bool = False,
    ) -> None:
        self._ray: Any = require("ray", "ray")
        self._arguments = module, workers, limit_s
        self._address, self._version, self._renders = address, version, renders
        self._nodes: dict[str, _RayNode] = {}
        self.refused: dict[str, str] = {}
        self.lost = 0

    def run(self, requests: Iterable[Mapping[str, Any]]) -> Generator[WorkerOutcome, None, None]:
        """Yield the outcome of each request, in the order in which they end.

        Raises:
            WorkersUnusable: There is no machine that can take work.
            OSError: A machine's disk is full.
        """
        mine = not self._ray.is_initialized()
        if mine:
            variables = {**THREADS, "PYTHONPATH": os.environ.get("PYTHONPATH", "")}
            runtime = {"env_vars": {name: value for name, value in variables.items() if value}}
            self._ray.init(self._address, log_to_driver=False, runtime_env=runtime)
        try:
            yield from self._outcomes(iter(requests))
        finally:
            for node in self._nodes.values():
                self._ray.kill(node.actor)
            self._nodes.clear()
            if mine:
                self._ray.shutdown()

    def _outcomes(self, waiting: Iterator[Mapping[str, Any]]) -> Iterator[WorkerOutcome]:
        again: deque[Mapping[str, Any]] = deque()
        tries: Counter[int] = Counter()
        began = looked = time.monotonic()
        self._take_up_nodes()
        exhausted = False
        while True:
            if time.monotonic() - looked >= _NODES_S:
                looked = time.monotonic()
                self._take_up_nodes()
            for node in [node for node in self._nodes.values() if node.checked]:
                while len(node.flying) < node.room and not (exhausted and not again):
                    request = again.popleft() if again else next(waiting, None)
                    if request is None:
                        exhausted = True
                        break
                    node.flying[node.actor.ask.remote(request)] = request, time.time()
            flying = [ref for node in self._nodes.values() for ref in node.flying]
            if exhausted and not again and not flying:
                return
            checks = [node.check for node in self._nodes.values() if not node.checked]
            if not flying and not checks and time.monotonic() - began > (0.0 if self.refused else START_LIMIT_S):
                raise WorkersUnusable(f"no machine of the cluster can take work: {self._why()}")
            done, _ = self._ray.wait([*flying, *checks], timeout=_LOOK_S) if flying or checks else ([], [])
            if not flying and not checks:
                time.sleep(_LOOK_S)
            for ref in done:
                for outcome in self._ended(ref, again, tries):
                    began = time.monotonic()
                    yield outcome

    def _ended(self, ref: Any, again: deque[Mapping[str, Any]], tries: Counter[int]) -> Iterator[WorkerOutcome]:
        """Yield the outcome behind a reference that is ready; a lost machine's requests are for others."""
        holder = next(((n, one) for n, one in self._nodes.items() if ref in one.flying or ref == one.check), None)
        if holder is None:
            return  # Of a machine whose loss is known already.
        name, node = holder
        try:
            answer = self._ray.get(ref)
        except self._ray.exceptions.RayError as problem:
            self.lost += 1
            if ref == node.check:  # It would fail again at every start.
                self._refuse(name, node, f"it cannot start: {problem}", again, None)
                return
            for request, handed_over_s in self._nodes.pop(name).flying.values():
                tries[id(request)] += 1
                if tries[id(request)] < MOST_TRIES:
                    again.append(request)
                else:
                    words = f"{MOST_TRIES} machines were lost with it, the last by {type(problem).__name__}"
                    span_s = time.time() - handed_over_s
                    yield WorkerOutcome(request, "crashed", {}, words, handed_over_s, span_s, 0)
            return
        if ref == node.check:
            self._admit(name, node, *answer)
            return
        request, _ = node.flying.pop(ref)
        if "unusable" in answer:
            self._refuse(name, node, answer["unusable"], again, request)
        elif "no_room" in answer:
            raise OSError(*answer["no_room"])
        else:
            yield WorkerOutcome(request=request, **answer)

    def _admit(self, name: str, node: _RayNode, version: str, undrawable: str) -> None:
        own = self._version()
        node.checked = version == own and not undrawable
        if not node.checked:
            words = undrawable or f"its program is of version {version}, that of this machine is {own}"
            self._refuse(name, node, words, deque(), None)

    def _refuse(
        self, name: str, node: _RayNode, why: str, again: deque[Mapping[str, Any]], request: Mapping[str, Any] | None
    ) -> None:
        """Give a machine no more work, and its requests to others."""
        again.extend(flying for flying, _ in node.flying.values())
        again.extend([] if request is None else [request])
        self.refused[name] = why
        self._ray.kill(node.actor)
        del self._nodes[name]

    def _take_up_nodes(self) -> None:
        """Start a pool on every machine that has joined."""
        module, workers, limit_s = self._arguments
        strategies = require("ray.util.scheduling_strategies", "ray")
        for found in self._ray.nodes():
            name, room = found["NodeID"], min(workers, int(found["Resources"].get("CPU", 0)))
            if not found["Alive"] or room < 1 or name in self._nodes or name in self.refused:
                continue
            here = strategies.NodeAffinitySchedulingStrategy(name, soft=False)
            pool = self._ray.remote(NodePool).options(
                num_cpus=room, max_concurrency=room + 1, max_restarts=0, scheduling_strategy=here
            )
            actor = pool.remote(module, workers, limit_s, os.getcwd())
            self._nodes[name] = _RayNode(actor, room, actor.check.remote(self._version, renders=self._renders))

    def _why(self) -> str:
        reasons = [f"{name[:8]}: {why}" for name, why in self.refused.items()]
        return "; ".join(reasons) or "it has none with a free CPU"
