"""A run that breaks at any of its seven requests goes on: nothing is paid twice, and it ends as one that did not break.

The seven requests are those of the five modules, of the Inspector and of the Supervisor, to a server on this machine.
`python -m tests.llm.client.test_going_on FILE` is such a run, so that it can be killed.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path
from threading import Event

import pytest

from llm.client.connect import connect
from llm.errors import CassetteError, ModelError
from llm.evolve import Situation
from llm.evolve.judges import judges
from llm.proposing.model_proposer import ModelProposer
from oag.model.actions import flow_to_json
from oag.revision import History, Revision
from tests.llm.evolve.scripted_judges import ajar, as_reply, attempt_of, critique_answer, revision_answer
from tests.llm.live import KEY, KEY_VARIABLE, hurry
from tests.llm.model_server import Act, ModelServer, Seen, fails, replies
from tests.llm.scripted_modules import QUERIES, right_answers, scene_of
from tests.source_tree import ROOT

MODEL = "openai-compatible:small"
CLOSED = [17, 1, 2, 3, {"19": [0.0, 0.9]}, 5]
ANSWERS = [as_reply(answer) for answer in right_answers("T1").values()]
# Room for one more answer, but not for what is kept free while another is awaited.
NEARLY_FULL = 100_000


def points(*fast: int) -> pytest.MarkDecorator:
    """Try a test at each of the seven requests; only some of them in every test run."""
    marked = [pytest.param(point, marks=() if point in fast else pytest.mark.slow) for point in range(7)]
    return pytest.mark.parametrize("point", marked)


def run(file: Path, *, resume: bool = False, configuration: str = MODEL) -> dict[str, object]:
    """Plan T1, judge a step and revise a flow, all by the model; return what came of it."""
    model = connect(configuration, record=file, resume=resume)
    proposal = ModelProposer(model, cross_check=False).propose(QUERIES["T1"], scene_of("T1"))
    seen, team = ajar(), judges(model, views=())
    critique = team.inspector.inspect(seen, 4)
    if team.stopped:
        raise InterruptedError(team.stopped)
    told = Situation(seen.task, 3, scene_of("T1"), attempt_of(seen, [critique]), History(3), observation=seen)
    revision = team.supervisor.revise(told)
    if team.stopped:
        raise InterruptedError(team.stopped)
    assert isinstance(revision, Revision), revision
    judged = [critique.motion_verified, critique.state_reached, critique.text]
    tokens = [model.usage.input_tokens, model.usage.output_tokens]
    return {"plan": proposal.to_json(), "judged": judged, "flow": flow_to_json(revision.flow), "tokens": tokens}


class Model:
    """Answers all seven requests rightly, except where something happens at one of them.

    Attributes:
        at: Position of a request, from 0 -> what is done in place of an answer, once.
        before: Position of a request -> called just before it is answered.
        paid: Question -> how often it was answered.
    """

    def __init__(self, at: dict[int, Act] | None = None) -> None:
        self.at, self.asked = at or {}, 0
        self.paid: Counter[str] = Counter()
        self.nearly_full_at: int | None = None
        self.file = Path()
        self.reached = Event()

    def __call__(self, seen: Seen) -> Act:
        position, self.asked = self.asked, self.asked + 1
        if position == self.nearly_full_at:
            limit_files(self.file.stat().st_size + NEARLY_FULL)
        if position in self.at:
            self.reached.set()
            return self.at.pop(position)
        self.paid[json.dumps(seen.body["messages"])] += 1
        text = "\n".join(seen.texts)
        module = next((n for n in range(1, 6) if f"Module {n} of 5" in text), 0)
        if module:
            return replies(ANSWERS[module - 1])
        judged = "Inspector: judge" in text
        return replies(as_reply(critique_answer(5, state_reached="no") if judged else revision_answer(CLOSED)))


def limit_files(size: int) -> None:
    """Let no file grow beyond a number of bytes, as on a full disk."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))


@pytest.fixture(autouse=True)
def _pointed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(KEY_VARIABLE, KEY)
    hurry(monkeypatch)


def serve(model: Model, monkeypatch: pytest.MonkeyPatch) -> ModelServer:
    server = ModelServer(decide=model, key=KEY)
    monkeypatch.setenv("SCENE2DEMO_MODEL_URL", server.address)
    return server


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, object], list[object]]:
    """What an undisturbed run ends in: its results, and the replies of its recording."""
    file = tmp_path_factory.mktemp("whole") / "run.jsonl"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(KEY_VARIABLE, KEY)
        model = Model()
        with serve(model, patch):
            result = run(file)
    assert model.asked == 7 and set(model.paid.values()) == {1}
    return result, replies_in(file)


def replies_in(file: Path) -> list[object]:
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    return [(line["digest"], line["reply"]["text"], line["made_by"]) for line in lines]


@points(0, 2, 5, 6)
def test_a_server_that_fails(
    point: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    undisturbed: tuple[dict[str, object], list[object]],
) -> None:
    # Refused at once; a 500 is sent again three times by itself, so four of them end a run.
    file, model = tmp_path / "run.jsonl", Model({point + again: fails(500, "out of memory") for again in range(4)})
    with serve(model, monkeypatch):
        with pytest.raises((ModelError, InterruptedError)):
            run(file)
        assert model.asked == point + 4 and len(model.paid) == point
        assert (run(file, resume=True), replies_in(file)) == undisturbed
    assert len(model.paid) == 7 and set(model.paid.values()) == {1}


@points(0, 4, 6)
def test_a_disk_that_is_full(
    point: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    undisturbed: tuple[dict[str, object], list[object]],
) -> None:
    file, model = tmp_path / "run.jsonl", Model()
    model.file, model.nearly_full_at = file, point - 1
    soft, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    with serve(model, monkeypatch):
        try:
            if point == 0:
                limit_files(NEARLY_FULL)
            with pytest.raises(CassetteError, match="cannot be written"):
                run(file)
        finally:
            limit_files(soft)
        assert model.asked == len(model.paid) == point
        assert (run(file, resume=True), replies_in(file)) == undisturbed
    assert model.asked == len(model.paid) == 7 and set(model.paid.values()) == {1}


@points(5)
def test_a_process_that_is_killed(
    point: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    undisturbed: tuple[dict[str, object], list[object]],
) -> None:
    file, model = tmp_path / "run.jsonl", Model({point: replies("{}", wait_s=30.0)})
    with serve(model, monkeypatch) as server:
        process = subprocess.Popen([sys.executable, "-m", __name__, str(file)], cwd=ROOT, env=os.environ.copy())
        assert model.reached.wait(120)
        process.send_signal(signal.SIGKILL)
        process.wait(60)
        assert model.asked == point + 1 and len(model.paid) == point
        # A power cut may leave half a line as well.
        with file.open("a") as stream:
            stream.write('{"cassette": 1, "digest": "')
        assert (run(file, resume=True), replies_in(file)) == undisturbed
        server.closing.set()
    assert model.asked == 8 and set(model.paid.values()) == {1}


def test_a_recording_goes_on_with_a_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, undisturbed: tuple[dict[str, object], list[object]]
) -> None:
    first, second = tmp_path / "first,run.jsonl", tmp_path / "second.jsonl"
    model = Model({4: fails(400, "no")})
    with serve(model, monkeypatch):
        with pytest.raises(ModelError):
            run(first)
        assert (run(second, configuration=f"replay:{first},{MODEL}"), replies_in(second)) == undisturbed
        assert set(model.paid.values()) == {1} and model.asked == 8
        other = connect(f"replay:{first},{MODEL}")
        with pytest.raises(CassetteError, match="of another run"):
            ModelProposer(other).propose(QUERIES["T2"], scene_of("T2"))
    assert model.asked == 8


def test_a_request_without_a_reply_in_time_is_not_sent_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    profiles = tmp_path / "p.toml"
    profiles.write_text("[openai-compatible]\ntimeout_s = 0.5\n")
    monkeypatch.setenv("SCENE2DEMO_PROFILES", str(profiles))
    file, model = tmp_path / "run.jsonl", Model({2: replies("{}", wait_s=20.0)})
    with serve(model, monkeypatch):
        with pytest.raises(ModelError, match="is not sent again unasked"):
            run(file)
        assert model.asked == 3
        run(file, resume=True)
    assert model.asked == 8 and set(model.paid.values()) == {1}


if __name__ == "__main__":
    run(Path(sys.argv[1]))
