"""Worker processes live long, and one that dies costs one request."""

from __future__ import annotations

import errno
import os
import time
from typing import Any

import pytest

from executor.system.workers import WorkerOutcome, WorkerPool, WorkerProcess, WorkersUnusable, _Deadline

ODD = "tests.executor.system.odd_worker"


def requests(*deeds: str) -> list[dict[str, Any]]:
    return [{"do": deed, "number": number} for number, deed in enumerate(deeds)]


def run(*deeds: str, workers: int = 1, **options: Any) -> dict[int, WorkerOutcome]:
    pool = WorkerPool(ODD, workers, **options)
    return {outcome.request["number"]: outcome for outcome in pool.run(requests(*deeds))}


def test_one_process_does_all_the_work() -> None:
    outcomes = run("work", "work", "work")
    assert [outcomes[k].answer["number"] for k in range(3)] == [0, 1, 2]
    assert len({outcome.answer["process"] for outcome in outcomes.values()}) == 1
    assert all(outcome.worker == outcome.answer["process"] != os.getpid() for outcome in outcomes.values())


def test_a_crash_costs_one_request() -> None:
    outcomes = run("work", "crash", "work", "work")
    assert [outcomes[k].ending for k in range(4)] == ["finished", "crashed", "finished", "finished"]
    assert "status 7" in outcomes[1].message
    assert outcomes[0].worker == outcomes[1].worker != outcomes[2].worker == outcomes[3].worker


def test_a_full_disk_ends_the_work() -> None:
    with pytest.raises(OSError, match="No space left") as full:
        run("work", "fill the disk", "work")
    assert full.value.errno == errno.ENOSPC and full.value.filename == "r/rollout.json"


def test_a_worker_of_another_program_ends_the_work() -> None:
    with pytest.raises(WorkersUnusable, match=r"runs version mine of the program, and the request is for .*'theirs'"):
        run("work", "be another program", "work")


def test_an_exception_is_an_answer_and_the_process_lives_on() -> None:
    outcomes = run("raise", "work")
    assert outcomes[0].ending == "error" and outcomes[0].message == "ValueError: odd request"
    assert outcomes[0].answer["kind"] == "ValueError"
    assert any("raise ValueError" in line for line in outcomes[0].answer["traceback"])
    assert outcomes[0].worker == outcomes[1].worker


def test_a_request_that_takes_too_long_is_ended() -> None:
    outcomes = run("hang", "work", limit_s=2.0)
    assert outcomes[0].ending == "timed-out" and "longer than 2 s" in outcomes[0].message
    assert outcomes[1].ending == "finished"


def test_several_processes_share_the_work() -> None:
    outcomes = run(*["work"] * 30, workers=2)
    assert sorted(outcomes) == list(range(30))
    assert all(outcome.ending == "finished" for outcome in outcomes.values())


def test_no_requests_start_no_process() -> None:
    assert run() == {}


@pytest.mark.parametrize("module", ["tests.executor.system.no_such_worker", "this"])
def test_a_worker_that_cannot_start_ends_everything(module: str) -> None:
    """`this` ends at once without a word of readiness, as a worker whose imports fail does."""
    with pytest.raises(WorkersUnusable, match="cannot be started"):
        list(WorkerPool(module, 2).run(requests("work", "work")))


def test_a_worker_that_hangs_at_its_start_ends_everything() -> None:
    pool = WorkerPool(ODD, 2, environment={"ODD_WORKER": "hangs at its start"}, start_limit_s=1.0)
    with pytest.raises(WorkersUnusable, match="odd_worker cannot be started: it was not ready within 1 s"):
        list(pool.run(requests("work", "work")))


def test_leaving_early_ends_every_process() -> None:
    outcomes = WorkerPool(ODD, 2).run(requests("work", "hang", "hang"))
    first = next(outcomes)
    began = time.monotonic()
    outcomes.close()
    assert time.monotonic() - began < 60.0, "the hanging requests were waited for"
    with pytest.raises(ProcessLookupError):
        os.kill(first.worker, 0)


def test_an_answer_that_comes_while_its_worker_is_killed_costs_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    receive = WorkerProcess.receive

    def receive_and_kill(self: WorkerProcess) -> dict[str, Any]:
        answer = receive(self)
        if answer.get("finished", {}).get("number") == 0:
            self.kill()
        return answer

    monkeypatch.setattr(WorkerProcess, "receive", receive_and_kill)
    outcomes = run("work", "work")
    assert [outcomes[k].ending for k in (0, 1)] == ["finished", "finished"]
    assert outcomes[0].worker != outcomes[1].worker


def test_a_clock_that_was_left_kills_nobody() -> None:
    worker = WorkerProcess(ODD)
    try:
        with _Deadline(worker, None) as deadline:
            pass
        deadline._time_out()
        assert not deadline.timed_out and not worker.killed
    finally:
        worker.close()
