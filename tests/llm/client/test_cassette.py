"""Record and replay: what was answered once is answered again, in order, and what was not is told apart."""

from __future__ import annotations

import json
import resource
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from llm.client.likeness import MOST_LINES, differences, nearest
from llm.client.recording import FAILURES, Continued, Exchange, Recorder, Replay, append_line, read_recording
from llm.client.transport import ChatReply, ChatRequest, Image, Message
from llm.errors import (
    BadReply,
    CassetteError,
    ModelError,
    ModelTimeout,
    ModelUnavailable,
    ReplayMissing,
)
from tests.llm.live import ASK, PNG, transport_to
from tests.llm.model_server import ModelServer, fails, replies
from tests.llm.scripted import Scripted

LOOK = ChatRequest("You see kitchens.", (Message(("What is on the table?", Image(PNG))),))


def outcome_of(transport: Recorder | Replay, request: ChatRequest) -> ChatReply | tuple[type, str]:
    """Return the reply, or the kind and the words of the failure."""
    try:
        return transport.complete(request)
    except ModelError as error:
        return type(error), str(error)


def test_a_run_replays_without_its_server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "run.jsonl"
    asked = [LOOK, ASK, ASK, LOOK, replace(ASK, temperature=0.1)]
    strange = "\u2028\x85\x1b half \ud800"
    acts = (replies("a glass — 杯"), replies("first"), replies(strange), fails(400, "no"), replies("<html>"))
    with ModelServer(*acts) as server:
        live = Recorder(transport_to(server, monkeypatch), file)
        first = [outcome_of(live, request) for request in asked]
    assert first[3] == (
        FAILURES["ModelRefused"],
        "openai-compatible:small: the server answered 400: no",
    )
    again = Replay(file)
    assert [outcome_of(again, request) for request in asked] == first
    assert again.warnings == ()
    assert isinstance(first[2], ChatReply) and first[2].text == strange
    assert len(file.read_text(encoding="utf-8").splitlines()) == len(asked)


def test_the_file_is_one_readable_exchange_a_line(tmp_path: Path) -> None:
    file = tmp_path / "run.jsonl"
    recorder = Recorder(Scripted("ein Glas für dich", BadReply("m", "broken")), file)
    recorder.complete(LOOK)
    outcome_of(recorder, LOOK)
    lines = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    assert [sorted(line) for line in lines] == [
        ["cassette", "digest", "made_by", "reply", "request"],
        ["cassette", "digest", "failure", "made_by", "request"],
    ]
    assert "ein Glas für dich" in file.read_text(encoding="utf-8")
    assert lines[0]["request"]["messages"][0]["parts"][1]["image"] == LOOK.images[0].sha256
    assert lines[0]["reply"]["latency_s"] == 0.25
    assert (lines[0]["reply"]["input_tokens"], lines[0]["reply"]["output_tokens"]) == (10, 5)
    assert "kitchen" not in str(lines[0]["request"]["messages"][0]["parts"][1])


def recorded(file: Path, *texts: str) -> Path:
    """Record one answer to each text."""
    recorder = Recorder(Scripted(*texts), file)
    for text in texts:
        recorder.complete(
            ChatRequest.of("system", f"a question about {text} and about nothing else in the kitchen, please answer")
        )
    return file


def test_a_missing_request_is_told_from_the_nearest_one(tmp_path: Path) -> None:
    file = recorded(tmp_path / "run.jsonl", "mugs", "glasses", "doors")
    replay = Replay(file)
    with pytest.raises(ReplayMissing) as caught:
        replay.complete(
            ChatRequest.of("system", "a question about grasses and about nothing else in the kitchen, please answer")
        )
    assert str(caught.value) == (
        f"replay:{file}: the request {caught.value.digest[:12]} was not recorded; the nearest is on line 2 of the "
        "file. Record the run again, with the same version, scene, query and seed. It differs in\n"
        "  messages[0].parts[0], from character 18: recorded …'a question about glasses and about nothing else ', "
        "asked …'a question about grasses and about nothing else '"
    )


def test_a_request_that_is_repeated_once_too_often_is_told(tmp_path: Path) -> None:
    file = tmp_path / "run.jsonl"
    recorder = Recorder(Scripted("one", "two"), file)
    replies_then = [recorder.complete(ASK).text, recorder.complete(ASK).text]
    replay = Replay(file)
    assert [replay.complete(ASK).text, replay.complete(ASK).text] == replies_then == ["one", "two"]
    with pytest.raises(ReplayMissing, match="was recorded 2 times, and is asked once more"):
        replay.complete(ASK)


def test_an_empty_recording_answers_nothing(tmp_path: Path) -> None:
    file = tmp_path / "run.jsonl"
    file.touch()
    with pytest.raises(ReplayMissing, match=r"the recording is empty\. Record a run first"):
        Replay(file).complete(ASK)


def test_differences_name_each_field(tmp_path: Path) -> None:
    other = replace(LOOK, messages=(Message(("What?", Image(b"other"))),), temperature=0.5, max_tokens=7)
    lines = differences(other.record(), LOOK.record())
    assert [line.split(":")[0] for line in lines] == [
        "messages[0].parts[0]",
        "messages[0].parts[1]",
        "temperature",
        "max_tokens",
    ]
    assert lines[2] == "temperature: recorded None, asked 0.5"
    assert f"{Image(b'other').sha256[:12]}… (5 bytes)" in lines[1]
    many = replace(LOOK, extra_body={str(number): number for number in range(20)})
    assert differences(many.record(), LOOK.record())[-1] == f"and {21 - MOST_LINES} more"


@given(st.lists(st.text(max_size=30), min_size=1, max_size=8), st.data())
def test_what_was_recorded_is_its_own_nearest(texts: list[str], data: st.DataObject) -> None:
    records = [ChatRequest.of("s", text).record() for text in texts]
    index = data.draw(st.sampled_from(range(len(texts))))
    assert nearest(records[index], records) == texts.index(texts[index])
    assert differences(records[index], records[index]) == ()


TEXTS = st.text(max_size=40)
REPLIES = st.builds(
    ChatReply,
    TEXTS,
    st.none() | st.integers(0, 10**9),
    st.none() | st.integers(0, 10**9),
    st.floats(0, 1e6),
    TEXTS,
    TEXTS,
    st.integers(1, 9),
)
FAILED = st.builds(lambda kind, *words: kind(*words), st.sampled_from([*FAILURES.values()]), TEXTS, TEXTS, TEXTS)


@given(st.lists(st.tuples(TEXTS, REPLIES | FAILED), max_size=5), st.data())
def test_every_prefix_of_a_file_reads_as_its_whole_lines(
    tmp_path_factory: pytest.TempPathFactory, exchanges: list[tuple[str, Any]], data: st.DataObject
) -> None:
    """A crash can cut a file anywhere: whatever was whole comes back, and the rest is told."""
    file = tmp_path_factory.mktemp("cut") / "run.jsonl"
    lines = []
    for text, outcome in exchanges:
        request = ChatRequest.of(text, text)
        lines.append(Exchange(request.record(), outcome, request.digest()).line())
        append_line(file, lines[-1])
    whole = "".join(lines).encode()
    cut = data.draw(st.integers(0, len(whole)))
    file.write_bytes(whole[:cut])
    exchanges_read, warnings = read_recording(file)
    ends = [0]
    for line in lines:
        ends.append(ends[-1] + len(line.encode()))
    complete = sum(end <= cut for end in ends) - 1
    assert bool(warnings) is (cut != ends[complete])
    assert [exchange.line() for exchange in exchanges_read] == lines[:complete]
    for exchange, (_, outcome) in zip(exchanges_read, exchanges, strict=False):
        assert type(exchange.outcome) is type(outcome) and str(exchange.outcome) == str(outcome)


def test_a_cut_off_recording_replays(tmp_path: Path) -> None:
    file = recorded(tmp_path / "run.jsonl", "mugs", "glasses")
    file.write_bytes(file.read_bytes()[:-20])
    replay = Replay(file)
    assert replay.warnings[0].startswith(f"{file}: the last line was cut off (")
    assert replay.warnings[0].endswith("is left out")


def test_a_recording_is_never_overwritten(tmp_path: Path) -> None:
    file = recorded(tmp_path / "run.jsonl", "mugs")
    before = file.read_bytes()
    with pytest.raises(CassetteError, match=r"exists already\. Name another one, or remove it"):
        Recorder(Scripted(), file)
    assert file.read_bytes() == before


def test_a_place_that_cannot_be_written_is_known_before_a_model_is_paid(tmp_path: Path) -> None:
    script = Scripted()
    with pytest.raises(CassetteError, match="cannot be written: No such file or directory"):
        Recorder(script, tmp_path / "none" / "run.jsonl")
    with pytest.raises(CassetteError, match="cannot be written"):
        Recorder(script, tmp_path)
    assert not script.asked


def test_a_missing_recording_is_said(tmp_path: Path) -> None:
    with pytest.raises(CassetteError, match=r"cannot be read: No such file or directory\. Record one first"):
        Replay(tmp_path / "none.jsonl")


def edited(line: str, **changes: Any) -> str:
    return json.dumps({**json.loads(line), **changes})


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda line: "hello", "Expecting value"),
        (lambda line: "[" * 100_000, "line 1 is no recorded exchange"),
        (lambda line: "", "Expecting value"),
        (lambda line: "\x00\xff", "line 1 is no recorded exchange"),
        (lambda line: '{"a": 1}', "the field 'cassette' is missing"),
        (lambda line: edited(line, cassette=2), "cassette: expected 1, got 2"),
        (lambda line: edited(line, request=[]), "request: expected an object, got []"),
        (lambda line: edited(line, request={"system": "other"}), "digest is not that of its request"),
        (lambda line: edited(line, request={"x": float("nan")}), "are JSON"),
        (lambda line: edited(line, reply=None), "neither a reply nor a failure"),
        (lambda line: edited(line, reply={}), "reply: the field 'text' is missing"),
        (lambda line: edited(line, reply={"text": "x", "words": 1}), "reply: the field 'input_tokens' is missing"),
        (
            lambda line: edited(line, reply={**json.loads(line)["reply"], "text": 7}),
            "reply.text: expected a string, got 7",
        ),
        (
            lambda line: edited(line, reply={**json.loads(line)["reply"], "attempts": True}),
            "reply.attempts: expected a whole number",
        ),
        (lambda line: line.replace('"reply"', '"answer"'), "has a key 'answer' that nothing reads"),
        (lambda line: line.replace('"reply": {', '"failure": {"kind": "SystemExit", '), "failure.kind: expected "),
        (lambda line: line.replace('"reply": {', '"failure": {"kind": [], '), "failure.kind: expected "),
        (
            lambda line: line.replace('"reply": {', '"failure": {"kind": "BadReply", '),
            "failure: the field 'problem' is missing",
        ),
    ],
)
def test_a_line_that_is_no_exchange_is_told(edit: Any, words: str, tmp_path: Path) -> None:
    file = recorded(tmp_path / "run.jsonl", "mugs")
    file.write_text(edit(file.read_text().rstrip("\n")) + "\n")
    with pytest.raises(CassetteError) as caught:
        Replay(file)
    assert words in str(caught.value)
    assert "line 1 " in str(caught.value)


def test_threads_write_whole_lines(tmp_path: Path) -> None:
    file = tmp_path / "run.jsonl"
    recorder = Recorder(Scripted(), file)

    def ask(number: int) -> None:
        for turn in range(10):
            recorder.complete(ChatRequest.of("x" * 5_000, f"{number} {turn}"))

    threads = [threading.Thread(target=ask, args=(number,)) for number in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(timeout=30)
    assert len(read_recording(file)[0]) == 60


def test_a_timeout_comes_again(tmp_path: Path) -> None:
    file = tmp_path / "run.jsonl"
    error = ModelTimeout("m", "no whole reply within 1 s", "Raise timeout_s, or ask for less")
    outcome_of(Recorder(Scripted(error), file), ASK)
    with pytest.raises(ModelTimeout) as caught:
        Replay(file).complete(replace(ASK, timeout_s=9.0))
    assert str(caught.value) == str(error)


def question(about: str) -> ChatRequest:
    """Return a request about something."""
    return ChatRequest.of("system", f"what about the {about}?")


def test_a_run_that_ended_early_goes_on_and_asks_nothing_again_that_was_answered(tmp_path: Path) -> None:
    file = tmp_path / "run.jsonl"
    first = Recorder(Scripted("of mugs", "of doors", ModelUnavailable("m", "the server answered 500")), file)
    told = [first.complete(question(about)).text for about in ("mug", "door")]
    with pytest.raises(ModelUnavailable):
        first.complete(question("cup"))
    # Killed while the next answer was written.
    with file.open("ab") as stream:
        stream.write(b'{"cassette": 1, "dig')
    script = Scripted("of cups", "of bowls")
    again = Recorder(script, file, resume=True)
    assert any("cut off" in note for note in again.notes) and any("2 answers" in note for note in again.notes)
    replies = [again.complete(question(about)) for about in ("mug", "door", "cup", "bowl")]
    assert [reply.text for reply in replies] == [*told, "of cups", "of bowls"]
    assert [reply.recorded for reply in replies] == [True, True, False, False]
    assert script.asked == [question("cup"), question("bowl")]
    # The whole run replays, and goes on once more.
    assert [Replay(file).complete(question(about)).text for about in ("mug", "door", "cup", "bowl")]
    third = Scripted("of plates")
    whole = Recorder(third, file, resume=True)
    assert [whole.complete(question(about)).recorded for about in ("mug", "door", "cup", "bowl", "plate")][-2:] == [
        True,
        False,
    ]
    assert third.asked == [question("plate")]


def test_equal_requests_go_on_with_their_answers_in_order(tmp_path: Path) -> None:
    file = tmp_path / "run.jsonl"
    first = Recorder(Scripted("one", "two"), file)
    for _ in range(2):
        first.complete(ASK)
    again = Recorder(Scripted("three"), file, resume=True)
    assert [again.complete(ASK).text for _ in range(3)] == ["one", "two", "three"]


def test_a_run_that_goes_on_with_a_recording_goes_on_itself(tmp_path: Path) -> None:
    earlier, file = tmp_path / "earlier.jsonl", tmp_path / "run.jsonl"
    first = Recorder(Scripted("one", "two", ModelUnavailable("m", "no")), earlier)
    assert [first.complete(question("mug")).text for _ in range(2)] == ["one", "two"]
    with pytest.raises(ModelUnavailable):
        first.complete(question("door"))
    lines = [json.loads(line) for line in earlier.read_text().splitlines()]
    for line in lines:
        line["made_by"]["version"] = "0.0.1"
    earlier.write_text("".join(json.dumps(line) + "\n" for line in lines))
    script = Scripted("of doors", ModelUnavailable("m", "no"))
    second = Recorder(Continued(Replay(earlier), script), file)
    assert [second.complete(question(about)).text for about in ("mug", "door")] == ["one", "of doors"]
    with pytest.raises(ModelUnavailable):
        second.complete(question("cup"))
    # Who made an answer stays with it.
    assert [exchange.version == "0.0.1" for exchange in read_recording(file)[0]] == [True, False, False]
    script = Scripted("of cups", "three")
    third = Recorder(Continued(Replay(earlier), script), file, resume=True)
    told = [third.complete(question(about)) for about in ("mug", "door", "cup", "mug", "mug")]
    assert [reply.text for reply in told] == ["one", "of doors", "of cups", "two", "three"]
    assert [reply.recorded for reply in told] == [True, True, False, True, False]
    assert script.asked == [question("cup"), question("mug")]


def test_a_run_that_goes_on_where_its_first_parts_are_finished_asks_the_model(tmp_path: Path) -> None:
    earlier, file = tmp_path / "earlier.jsonl", tmp_path / "run.jsonl"
    Recorder(Scripted("of mugs"), earlier).complete(question("mug"))
    assert Recorder(Continued(Replay(earlier), Scripted()), file).complete(question("mug")).recorded
    again = Recorder(Continued(Replay(earlier), Scripted("of cups")), file, resume=True, same_start=False)
    assert again.complete(question("cup")).text == "of cups"


def test_another_runs_recording_is_not_gone_on_with(tmp_path: Path) -> None:
    file = recorded(tmp_path / "run.jsonl", "mugs")
    before, script = file.read_bytes(), Scripted("of grasses")
    with pytest.raises(ReplayMissing, match="another run's"):
        Recorder(script, file, resume=True).complete(question("grass"))
    assert not script.asked and file.read_bytes() == before
    # Where finished parts ask nothing, the first question may be a later one's.
    assert Recorder(script, file, resume=True, same_start=False).complete(question("grass")).text == "of grasses"


def test_nothing_is_gone_on_with_where_nothing_was_answered(tmp_path: Path) -> None:
    file = tmp_path / "run.jsonl"
    with pytest.raises(ModelUnavailable):
        Recorder(Scripted(ModelUnavailable("m", "no connection")), file).complete(question("mug"))
    assert Recorder(Scripted("of cups"), file, resume=True).complete(question("cup")).text == "of cups"
    assert len(read_recording(file)[0]) == 1


def test_nobody_is_paid_for_an_answer_that_could_not_be_kept(tmp_path: Path) -> None:
    file, script = tmp_path / "run.jsonl", Scripted("of mugs")
    recorder = Recorder(script, file)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2_000, hard))
    try:
        with pytest.raises(CassetteError, match="cannot be written"):
            recorder.complete(question("mug"))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not script.asked and file.read_bytes() == b""
    assert recorder.complete(question("mug")).text == "of mugs"


def test_recordings_without_the_number_of_attempts_are_read(tmp_path: Path) -> None:
    file = tmp_path / "run.jsonl"
    late = ModelTimeout("m", "no whole reply within 120 s")
    late.attempts = 4
    with pytest.raises(ModelTimeout):
        Recorder(Scripted(late), file).complete(ASK)
    ((exchange,), _) = read_recording(file)
    assert isinstance(exchange.outcome, ModelTimeout) and exchange.outcome.attempts == 4
    old = json.loads(file.read_text())
    del old["failure"]["attempts"]
    file.write_text(json.dumps(old) + "\n")
    ((exchange,), _) = read_recording(file)
    assert isinstance(exchange.outcome, ModelTimeout) and exchange.outcome.attempts == 1
