"""What an evolution leaves to read: pairs of failure and correction, and its story in the report."""

from __future__ import annotations

import json
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import jsonschema
import pytest
from PIL import Image

import oag
from executor.reports.html import render
from executor.reports.page import evolution_values
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.evolution_record import AttemptPictures, Evolution, draw_attempts, shown_step
from executor.rollouts.evolve import evolve
from executor.rollouts.run_record import pairs, write_pairs
from tests.executor.rollouts.tasks import AJAR, closing
from tests.source_tree import ROOT

pytestmark = pytest.mark.physics
SCHEMA = ROOT / "executor" / "rollouts" / "evolution_pairs.schema.json"


def evolution_section(evolution: Evolution, pictures: AttemptPictures) -> str:
    """Return the report's section about an episode."""
    return render("evolution.html", **evolution_values(evolution, pictures))


@pytest.fixture(scope="module")
def closed() -> Evolution:
    """A door that was left ajar, evolved."""
    return evolve(closing(), seed=7001)


def test_a_pair_follows_its_schema_and_says_all(closed: Evolution, tmp_path: Path) -> None:
    path = write_pairs(tmp_path / "pairs.jsonl", closed, {(0, 0): ["frames/T1_attempt1_step4_global_1.jpg"]})
    (line,) = path.read_text().splitlines()
    pair = json.loads(line)
    schema = json.loads(SCHEMA.read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(pair, schema)
    assert pair["failing_flow"] == AJAR
    assert pair["revision"]["flow"] == [1, 2, 3, {"19": [0.0, 0.5]}, 5]
    assert pair["failure"]["kind"] == "goal-not-reached" and pair["failure"]["step"] is None
    assert pair["outcome"] == {"subtask_reached": True, "stood": True, "failure": None, "episode_succeeded": True}
    assert pair["frames"] == ["frames/T1_attempt1_step4_global_1.jpg"]
    assert [critique["step"] for critique in pair["critiques"]] == [0, 1, 2, 3, 4]


def test_the_checkpoint_of_a_pair_is_where_the_attempt_began(closed: Evolution) -> None:
    import base64

    (pair,) = pairs(closed)
    reproduce = pair["reproduce"]
    assert isinstance(reproduce, dict)
    start = Checkpoint.from_bytes(base64.b64decode(reproduce["checkpoint"]))
    assert start.to_bytes() == closed.stories[0].records[0].checkpoint
    assert reproduce["state_hash"] == closed.stories[0].records[0].state_hash


@pytest.mark.parametrize("damage", ["schema", "frames", "outcome", "reproduce"])
def test_the_schema_refuses_what_lacks_something(closed: Evolution, damage: str) -> None:
    (pair,) = pairs(closed)
    del pair[damage]
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(json.loads(json.dumps(pair)), json.loads(SCHEMA.read_text()))


def test_the_report_tells_attempts_changes_and_results(closed: Evolution) -> None:
    html = evolution_section(closed, AttemptPictures(problem="this machine has no renderer"))
    assert html.count("<div class='attempt ") == 2
    assert "class='attempt lost'" in html and "class='attempt won'" in html
    assert "<li class='gone'>ARTICULATE_CLOSE 0 0.3</li>" in html
    assert "<li class='new'>4. ARTICULATE_CLOSE 0 0.5</li>" in html
    assert (
        "at-fault" in html
        and "Therefore raise the upper limit from 0.3 to 0.5: 0.20 of the range was left open." in html
    )
    assert "No pictures: this machine has no renderer." in html


def test_the_report_tells_what_was_refused_and_nothing_of_it_becomes_markup(closed: Evolution) -> None:
    first, *others = closed.stories[0].history.iterations
    assert first.revision is not None
    revision = replace(first.revision, refused=("[99]: flow/unknown-primitive: <b>99</b> is none",))
    history = replace(closed.stories[0].history, iterations=(first._replace(revision=revision), *others))
    html = evolution_section(replace(closed, stories=(replace(closed.stories[0], history=history),)), AttemptPictures())
    assert "1 answer was refused before anything moved" in html
    assert "flow/unknown-primitive: &lt;b&gt;99&lt;/b&gt; is none" in html


def test_the_report_shows_the_pictures_that_there_are(closed: Evolution) -> None:
    stored = BytesIO()
    Image.new("RGB", (48, 32)).save(stored, format="JPEG")
    html = evolution_section(closed, AttemptPictures({(0, 0): {"head": (stored.getvalue(),) * 2}}))
    assert html.count('src="data:image/jpeg;base64,') == 2 and "head view, picture 2" in html
    assert html.count('width="48" height="32"') == 2
    assert "No pictures" not in html


def test_nothing_in_the_report_becomes_markup(closed: Evolution) -> None:
    iteration = closed.stories[0].history.iterations[0]
    attempt = replace(iteration.attempt, message="<script>alert(1)</script>")
    history = replace(
        closed.stories[0].history,
        iterations=(oag.Iteration(attempt, iteration.revision), *closed.stories[0].history.iterations[1:]),
    )
    story = replace(closed.stories[0], history=history)
    html = evolution_section(replace(closed, stories=(story,)), AttemptPictures())
    assert "<script>" not in html and "&lt;script&gt;" in html


def test_the_step_at_fault_is_the_one_that_is_shown(closed: Evolution, tmp_path: Path) -> None:
    first, second = (attempt for attempt, _ in closed.stories[0].history.iterations)
    assert (shown_step(first), shown_step(second)) == (3, 4)
    drawn = draw_attempts(closed, tmp_path)
    assert not drawn.drawn and not drawn.files and drawn.problem == "nothing was asked to draw them"
