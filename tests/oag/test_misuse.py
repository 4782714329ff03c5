"""Arguments of another kind, and files that say two things: each gets a typed error with what to do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import oag
from bddl.files import MOST_BYTES
from oag.model.actions import flow_from_json
from oag.model.diagnostics import FlowError, InputError, NoSuchSubtask
from oag.revision import admissible
from tests.oag.paper import DATA, scene, task_json, verify

# Nothing here passes the type checker, which is the point.
untyped: Any = oag
untyped_admissible: Any = admissible
MISUSE: list[tuple[Any, type[Exception], str]] = [
    (
        lambda: untyped.compose(None),
        oag.TaskError,
        "expected a Task, got None",
    ),
    (
        lambda: untyped.compose(DATA / "T1.json", scene="scene.json"),
        oag.SceneError,
        "expected a Scene, got 'scene.json'",
    ),
    (lambda: untyped.compose(untyped.Task.from_json(task_json("T1"), scene="s.json")), oag.SceneError, "got 's.json'"),
    (lambda: untyped.complete(task_json("T1")), oag.TaskError, "expected a Task, got {"),
    (lambda: untyped.canonical(task_json("T1")), oag.TaskError, "oag.Task.from_json reads one"),
    (lambda: untyped.canonical_digest(None), oag.TaskError, "expected a Task, got None"),
    (lambda: untyped_admissible(t1(), "0", []), NoSuchSubtask, "one of its 4 subtasks, from 0, got '0'"),
    (lambda: untyped_admissible(t1(), True, []), NoSuchSubtask, "got True"),
    (lambda: untyped_admissible(t1(), 4, []), NoSuchSubtask, "got 4"),
    (lambda: untyped_admissible(task_json("T1"), 0, []), oag.TaskError, "expected a Task"),
]


def t1() -> oag.Task:
    return oag.Task.from_json(task_json("T1"), scene=scene("T1"))


@pytest.mark.parametrize(("call", "kind", "said"), MISUSE)
def test_misuse_says_what_was_expected(call: Any, kind: type[Exception], said: str) -> None:
    with pytest.raises(kind) as caught:
        call()
    assert said in str(caught.value)


def test_a_report_without_a_certificate_says_so() -> None:
    malformed = verify({**task_json("T1"), "goal": "(and"}, "T1")
    for given in (malformed.certificate, malformed, malformed.to_json()):
        result = oag.recheck(given)
        assert not result and "a report has none when its plan is not well formed" in result.reason


def test_the_certificate_is_found_in_a_report() -> None:
    report = verify(task_json("T1"), "T1")
    assert oag.recheck(report) and oag.recheck(report.to_json()) and oag.recheck(report.certificate)


def test_subtasks_are_listed_in_one_way() -> None:
    data = task_json("T1")
    with pytest.raises(oag.TaskError, match="sub_task_1 stands beside the list"):
        oag.Task.from_json({**data, "sub_task_1": data["sub_tasks"][0]})


@pytest.mark.parametrize("task", [{"sub_tasks": []}])
def test_a_task_without_subtasks_is_warned_of(task: Any) -> None:
    report = oag.compose(task, scene("T1")).verify()
    assert [(finding.code, finding.severity) for finding in report.diagnostics] == [("task/empty", "warning")]


@pytest.mark.parametrize(
    "number", [10**400, -(10**400), 10**5000, [0, 10**400]], ids=["large", "negative", "unwritable", "pair"]
)
def test_numbers_beyond_all_floats_are_findings(number: Any) -> None:
    data = task_json("T1")
    data["sub_tasks"][1]["flow"][-1] = {"7": number}
    report = verify(data, "T1")
    assert [(error.code, error.subtask, error.step) for error in report.errors] == [("flow/parameter", 1, 4)]
    admission = admissible(t1(), 1, data["sub_tasks"][1]["flow"])
    assert [finding.code for finding in admission.diagnostics] == ["flow/parameter"]
    with pytest.raises(oag.TaskError, match="expected a number"):
        oag.Task.from_json({**task_json("T1"), "scales": {"glass_0": number}})


def test_an_id_of_thousands_of_digits_is_unknown() -> None:
    with pytest.raises(FlowError, match="unknown primitive"):
        flow_from_json([{"1" * 5000: 0.3}])


@pytest.mark.parametrize("read", [oag.Scene.from_json, oag.Task.from_json])
def test_files_of_the_package_say_why_they_are_not_read(read: object, tmp_path: Path) -> None:
    assert callable(read)
    large = tmp_path / "large.json"
    with large.open("wb") as stream:
        stream.truncate(MOST_BYTES + 1)
    for path, said in ((large, "cannot be read: it is larger than 8 MB"), (Path("/dev/zero"), "it is no regular file")):
        with pytest.raises(InputError, match=said):
            read(path)
