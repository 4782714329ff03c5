"""A Ray cluster of two machines: nothing is lost or double, also when one is lost; another version gets no work."""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest

from executor.campaign.ray_engine import RayEngine
from executor.system.workers import WorkersUnusable

ray: Any = pytest.importorskip("ray")
Cluster: Any = pytest.importorskip("ray.cluster_utils").Cluster
pytestmark = pytest.mark.slow
MODULE = "tests.executor.campaign.stub_worker"
SMALL = {"num_cpus": 2, "object_store_memory": 80 * 2**20}


def version() -> str:
    """Return the version of this program."""
    return "one"


def other_version() -> str:
    """Return a version that differs between this process and others."""
    return str(os.getpid())


@pytest.fixture
def cluster() -> Iterator[Any]:
    """Start two machines on this one."""
    os.environ["PYTHONPATH"] = os.pathsep.join(path for path in sys.path if path)
    made = Cluster(initialize_head=True, head_node_args={**SMALL, "include_dashboard": False})
    made.second = made.add_node(**SMALL)
    yield made
    ray.shutdown()
    made.shutdown()


def test_all_requests_are_answered_once_though_a_machine_is_lost(cluster: Any) -> None:
    engine = RayEngine(cluster.address, MODULE, 2, 60.0, version=version)
    requests = [{"number": number, "sleep_s": 0.01} for number in range(2000)]

    outcomes = []
    for outcome in engine.run(requests):
        outcomes.append(outcome)
        if len(outcomes) == 200:
            cluster.remove_node(cluster.second, allow_graceful=False)
    assert engine.lost >= 1
    assert Counter(outcome.ending for outcome in outcomes) == {"finished": 2000}
    assert sorted(outcome.answer["number"] for outcome in outcomes) == list(range(2000))
    assert all(outcome.request in requests for outcome in outcomes[:20])


def test_a_process_that_crashes_costs_its_request(cluster: Any) -> None:
    engine = RayEngine(cluster.address, MODULE, 2, 60.0, version=version)
    requests = [{"number": number, "crash": number == 3} for number in range(8)]
    ended = {outcome.request["number"]: outcome.ending for outcome in engine.run(requests)}
    assert ended == {number: "crashed" if number == 3 else "finished" for number in range(8)}


def test_machines_of_another_version_get_no_work(cluster: Any) -> None:
    engine = RayEngine(cluster.address, MODULE, 2, 60.0, version=other_version)
    with pytest.raises(WorkersUnusable, match="its program is of version"):
        list(engine.run([{"number": 1}]))
    assert len(engine.refused) == 2
