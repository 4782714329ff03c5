"""The ablation of feedback: one recording has the attempts with fewer rounds, and nobody is asked for the table."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks import feedback
from llm.client.budget import Metered
from llm.client.connect import connect
from llm.client.recording import Recorder
from llm.client.transport import Sampled
from tests.llm.scripted_modules import Script, Wrong, right_answers, scene_of, without_subtask

QUERY = "put the glass into the refrigerator"


def test_queries_are_forty_over_ten_scenes_in_one_order() -> None:
    asked = feedback.queries()
    assert len(set(asked)) == len(asked) == 40 and len({scene for scene, _ in asked}) == 10
    assert asked == feedback.queries()


def test_fewer_rounds_are_the_beginning_of_the_recorded_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A model that forgets to open the door plans with one round of feedback, and not without."""
    right = right_answers("T1")
    forgets = without_subtask(right, 2, 0)
    opened: list[Script] = []

    def connected(model: str, **options: Any) -> Metered:
        if model.startswith("replay:"):
            return connect(model, **options)
        opened.append(Script(right, {2: [Wrong(forgets, "")]}))
        return Metered(Sampled(Recorder(opened[-1], options["record"]), seed=options["seed"]))

    monkeypatch.setattr(feedback, "connect", connected)
    monkeypatch.setattr(feedback, "load_scene", lambda _: scene_of("T1"))
    monkeypatch.setattr(feedback, "queries", lambda: [("kitchen_t1", QUERY)])
    feedback.record(tmp_path, "scripted", [0], 60.0)
    assert all(request.json_schema is None for request in opened[1].asked)
    _, _, *rows, answers = feedback.table([tmp_path], execute=False)
    found = {row.split(" | ")[0].rpartition(", ")[2]: row.split(" | ")[1:] for row in rows}
    assert list(found) == list(feedback.WAYS)
    proved = {way: cells[1][0] for way, cells in found.items()}
    assert proved == {"unconstrained": "0", "checked": "0", "feedback 1": "1", "feedback 3": "1"}
    assert float(found["checked"][5]) < float(found["feedback 1"][5]) == float(found["feedback 3"][5])
    assert f"{sum(len(script.asked) for script in opened)} recorded answers" in answers


def test_an_unconstrained_answer_that_names_what_is_not_there_is_no_plan() -> None:
    """A model of 0.5 billion wrote `bottle` for `bottle_0`; nobody had checked it."""
    right, scene = right_answers("T1"), scene_of("T1")
    wrong = {module: json.loads(json.dumps(answer).replace("glass_0", "glass")) for module, answer in right.items()}
    assert feedback.attempt(Script(right, {}), feedback.FREE, QUERY, scene) is not None
    assert feedback.attempt(Script(wrong, {}), feedback.FREE, QUERY, scene) is None
