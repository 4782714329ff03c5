"""Requests over the real protocol: what arrives at the server, what comes back, and what each misbehaviour becomes."""

from __future__ import annotations

import gzip
import hashlib
import io
import signal
import sys
import threading
import time
import tracemalloc
from dataclasses import replace
from typing import Any

import pytest
from PIL import Image as Picture

from llm.client.openai import OpenAITransport
from llm.client.profiles import find_profile, listed, tables
from llm.client.transport import ChatRequest, Image, Message
from llm.errors import (
    BadReply,
    ModelConfigError,
    ModelError,
    ModelRefused,
    ModelTimeout,
    ModelUnavailable,
    ReplyTooLong,
    RequestError,
)
from tests.llm.live import ASK, BAD_PICTURES, KEY, KEY_VARIABLE, PNG, profile_of, transport_to
from tests.llm.model_server import Act, ModelServer, fails, replies


def picture(seed: int) -> Image:
    """Return a PNG of noise, about 12 kB."""
    data = io.BytesIO()
    Picture.frombytes("RGB", (64, 64), hashlib.shake_256(bytes([seed])).digest(64 * 64 * 3)).save(data, "PNG")
    return Image(data.getvalue())


STREAMED = pytest.mark.parametrize("stream", [False, True], ids=["whole", "streamed"])


@STREAMED
def test_a_reply_comes_back_with_its_counts(stream: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    with ModelServer(replies('{"room": "küche — 厨房"} and words'), key=KEY) as server:
        reply = transport_to(server, monkeypatch, stream=stream).complete(ASK)
    assert reply.text == '{"room": "küche — 厨房"} and words'
    assert (reply.model, reply.finish_reason, reply.attempts) == ("small", "stop", 1)
    assert reply.output_tokens == 6
    assert reply.input_tokens is not None and reply.input_tokens > 4
    assert reply.latency_s > 0
    assert bool(server.seen[0].body.get("stream")) is stream


def test_images_arrive_byte_for_byte_and_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    sent = tuple(picture(seed) for seed in range(3))
    first = Message(("before", sent[0], "between", sent[1]))
    request = ChatRequest("", (first, Message(("I see two.",), "assistant"), Message((sent[2], "and now?"))))
    with ModelServer(fails(503), replies("three")) as server:
        transport_to(server, monkeypatch).complete(request)
    wanted = tuple(image.sha256 for image in sent)
    for seen in server.seen:  # the retry too
        assert tuple(hashlib.sha256(data).hexdigest() for data in seen.images) == wanted
        assert seen.texts == ("before", "between", "I see two.", "and now?")
    assert len(server.seen) == 2


@pytest.mark.parametrize(
    ("mode", "wanted"),
    [
        ("json_schema", {"type": "json_schema", "json_schema": {"name": "answer", "schema": {"type": "object"}}}),
        ("json_object", {"type": "json_object"}),
        ("plain", None),
    ],
)
def test_json_is_asked_for_as_the_profile_says(mode: Any, wanted: object, monkeypatch: pytest.MonkeyPatch) -> None:
    with ModelServer() as server:
        transport = transport_to(server, monkeypatch, mode=mode)
        transport.complete(ASK)
        transport.complete(replace(ASK, json_schema=None))
        transport.complete(replace(ASK, mode="plain"))
    assert [seen.body.get("response_format") for seen in server.seen] == [wanted, None, None]


def test_a_schema_is_strict_where_the_endpoint_knows_that(monkeypatch: pytest.MonkeyPatch) -> None:
    with ModelServer() as server:
        transport_to(server, monkeypatch, mode="json_schema", strict=True).complete(ASK)
    assert server.seen[0].body["response_format"]["json_schema"]["strict"] is True
    assert {provider for provider, table in tables().items() if table.get("strict")} == {
        "openai",
        "vllm",
        "llama-cpp",
        "local",
    }


def test_the_system_text_goes_where_the_profile_says(monkeypatch: pytest.MonkeyPatch) -> None:
    later = replace(ASK, messages=(Message(("hello",), "assistant"), *ASK.messages))
    with ModelServer() as server:
        transport_to(server, monkeypatch, system_role="system").complete(ASK)
        transport_to(server, monkeypatch, system_role="user").complete(ASK)
        transport_to(server, monkeypatch, system_role="user").complete(later)
    roles = [[message["role"] for message in seen.body["messages"]] for seen in server.seen]
    assert roles == [["system", "user"], ["user"], ["user", "assistant", "user"]]
    assert server.seen[0].texts == server.seen[1].texts == ("Answer in JSON.", "Where is the mug?")


def test_numbers_and_further_fields_go_as_the_profile_says(monkeypatch: pytest.MonkeyPatch) -> None:
    request = replace(ASK, temperature=0.5, max_tokens=99, extra_body={"seed": 7, "top_p": 0.5})
    extra = {"top_p": 1.0, "enable_thinking": False}
    with ModelServer() as server:
        transport_to(server, monkeypatch, extra_body=extra).complete(request)
        changes = {"send_temperature": False, "max_tokens_field": "max_completion_tokens"}
        transport_to(server, monkeypatch, **changes).complete(request)
    first, second = (seen.body for seen in server.seen)
    assert (first["temperature"], first["max_tokens"], first["seed"]) == (0.5, 99, 7)
    assert (first["top_p"], first["enable_thinking"]) == (0.5, False)
    assert "temperature" not in second and "max_tokens" not in second
    assert second["max_completion_tokens"] == 99


@pytest.mark.parametrize("configuration", listed(tables()))
def test_every_listed_model_is_asked_in_a_form_that_the_protocol_allows(
    configuration: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    listed = find_profile(configuration)
    monkeypatch.setenv("SOME_KEY", KEY)
    with ModelServer(replies("fine"), key=KEY) as server:
        changes = {"base_url": server.address, "base_url_variable": "", "key_variable": "SOME_KEY"}
        profile = listed.model_copy(update=changes)
        assert OpenAITransport(profile).complete(ASK).text == "fine"
    assert server.seen[0].body["model"] == listed.model


def test_too_many_images_are_refused_before_anything_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    request = ChatRequest.of("", picture(0), picture(1))
    with ModelServer() as server, pytest.raises(RequestError, match=r"has 2 images, and .* takes at most 1"):
        transport_to(server, monkeypatch, max_images=1).complete(request)
    assert not server.seen


@pytest.mark.parametrize("bad", [{"seed": float("nan")}, {"seed": {1}}, {"user": "\ud800"}], ids=["nan", "set", "half"])
def test_what_is_no_json_is_refused_before_anything_is_sent(
    bad: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    with ModelServer() as server, pytest.raises(RequestError, match="cannot be written as JSON"):
        transport_to(server, monkeypatch).complete(replace(ASK, extra_body=bad))
    assert not server.seen


MISBEHAVIOURS: dict[str, tuple[Act, type[ModelError], str, int]] = {
    "server error": (fails(500, "out of memory"), ModelUnavailable, "answered 500: out of memory (3 attempts)", 3),
    "gateway page": (Act(status=502, body=b"<h1>Bad Gateway</h1>"), ModelUnavailable, "502: <h1>Bad Gateway</h1>", 3),
    "busy": (fails(429, "slow down", retry_after="0.01"), ModelUnavailable, "answered 429: slow down (3 attempts)", 3),
    "busy for an hour": (fails(429, "quota", retry_after="3600"), ModelUnavailable, "It asks to wait 3600 s", 1),
    "busy for ever": (fails(429, "quota", retry_after="9" * 5_000), ModelUnavailable, "asks to wait 999999999999 s", 1),
    "bad request": (fails(400, "no such field"), ModelRefused, "answered 400: no such field", 1),
    "wrong key": (fails(401, "wrong"), ModelRefused, f"Check the key in {KEY_VARIABLE}", 1),
    "wrong model": (fails(404, "no such model"), ModelRefused, "Check the model's name", 1),
    "too large": (fails(413, "too large"), ModelRefused, "Send fewer or smaller images", 1),
    "endless error": (Act(status=500, body=b"x" * 1_000_000), ModelUnavailable, "xxx... (3 attempts)", 3),
    "cut off": (replies("words " * 50, cut_at=200), ModelUnavailable, "broke before the answer was whole", 3),
    "reset": (Act(reset=True), ModelUnavailable, "broke before the answer was whole", 3),
    "broken JSON": (Act(body=b'{"choices": [{"message"'), BadReply, "is broken JSON", 1),
    "deep JSON": (Act(body=b'{"a":' * 10_000), BadReply, "broken JSON", 1),
    "web page": (Act(body=b"<html>hi</html>", content_type="text/html"), BadReply, "text/html instead of JSON", 1),
    "no JSON at all": (Act(body=b"\xff\xfe\x00"), BadReply, "instead of JSON", 1),
    "JSON of another kind": (Act(body=b"[1, 2]"), BadReply, "has no choices", 1),
    "error with status 200": (Act(body=b'{"error": {"message": "overloaded"}}'), BadReply, "no choices: overloaded", 1),
    "no choices": (Act(fields={"choices": []}), BadReply, "has no choices", 1),
    "choice of another kind": (Act(fields={"choices": [7]}), BadReply, "has no choices", 1),
    "no message": (Act(fields={"choices": [{}]}), BadReply, "a choice without a message", 1),
    "steering": (fails(400, "\x1b]0;owned\x07 \x1b[2J"), ModelRefused, "400: \u241b]0;owned\u2407 \u241b[2J", 1),
    "steering page": (Act(body=b"\x1b[31mred"), BadReply, "instead of JSON", 1),
    "moved": (Act(status=307, headers={"Location": "http://127.0.0.1:9/v1"}), ModelRefused, "answered 307", 1),
    "moved for good": (Act(status=301, headers={"Location": "/v2"}), ModelRefused, "Redirects are not followed", 1),
    "moved nowhere": (Act(status=302), ModelRefused, "points elsewhere", 1),
    "not modified": (Act(status=304), ModelRefused, "answered 304", 1),
    "huge": (replies("x" * 200_000), ReplyTooLong, "longer than 100000 bytes", 1),
}  # fmt: skip


@pytest.mark.parametrize("name", MISBEHAVIOURS)
def test_each_misbehaviour_has_its_outcome(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    act, kind, words, times = MISBEHAVIOURS[name]
    with ModelServer(act) as server, pytest.raises(ModelError) as caught:
        transport_to(server, monkeypatch).complete(ASK)
    assert type(caught.value) is kind
    assert words in str(caught.value)
    assert str(caught.value).isprintable()
    assert str(caught.value).startswith("openai-compatible:small: ")
    assert len(server.seen) == times


def test_a_redirect_takes_the_key_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    with ModelServer() as elsewhere:
        moved = Act(status=308, headers={"Location": f"{elsewhere.address}/chat/completions"})
        with ModelServer(moved) as server, pytest.raises(ModelRefused, match="points elsewhere, to 'http://127"):
            transport_to(server, monkeypatch).complete(ASK)
    assert len(server.seen) == 1 and not elsewhere.seen


def event(data: str) -> str:
    return f"data: {data}\n\n"


PIECE = event('{"choices": [{"delta": {"content": "half "}}]}')
STREAMS: dict[str, tuple[str, type[ModelError], str, int]] = {
    "ends without an end": (PIECE, ModelUnavailable, "was cut off", 3),
    "ends within an event": (PIECE + 'data: {"choices": [{"del', ModelUnavailable, "was cut off", 3),
    "an error on the way": (PIECE + event('{"error": {"message": "gpu gone"}}'), ModelUnavailable, "gpu gone", 3),
}


@pytest.mark.parametrize("name", STREAMS)
def test_a_stream_that_goes_wrong_has_its_outcome(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    body, kind, words, times = STREAMS[name]
    act = Act(body=body.encode(), content_type="text/event-stream")
    with ModelServer(act) as server, pytest.raises(ModelError) as caught:
        transport_to(server, monkeypatch, stream=True).complete(ASK)
    assert type(caught.value) is kind
    assert words in str(caught.value)
    assert len(server.seen) == times


SPEECHLESS: dict[str, tuple[dict[str, object], str, str]] = {
    "no text": ({"message": {"content": ""}, "finish_reason": "stop"}, "", "stop"),
    "null": ({"message": {"content": None}, "finish_reason": "stop"}, "", "stop"),
    "thought too long": ({"message": {"content": ""}, "finish_reason": "length"}, "", "length"),
    "thoughts only": ({"message": {"content": None, "reasoning_content": '{"goal": "draft"}'}}, "", ""),
    "thoughts in parts": ({"message": {"content": [{"type": "thinking", "text": '{"goal": "draft"}'}]}}, "", ""),
    "a tool is called": (
        {"message": {"content": None, "tool_calls": [{}]}, "finish_reason": "tool_calls"},
        "",
        "tool_calls",
    ),
    "declined": ({"message": {"content": None, "refusal": "I will not"}}, "I will not", ""),
}


@pytest.mark.parametrize("name", SPEECHLESS)
def test_a_model_that_says_nothing_has_replied_and_is_counted(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever asked can ask again; what was thought is paid for."""
    choice, text, finish = SPEECHLESS[name]
    usage = {"prompt_tokens": 7, "completion_tokens": 900}
    with ModelServer(Act(fields={"choices": [choice], "usage": usage})) as server:
        reply = transport_to(server, monkeypatch).complete(ASK)
    assert (reply.text, reply.finish_reason, reply.output_tokens) == (text, finish, 900)
    body = event("[DONE]").encode()
    with ModelServer(Act(body=body, content_type="text/event-stream")) as server:
        assert transport_to(server, monkeypatch, stream=True).complete(ASK).text == ""


def test_prose_around_json_is_the_callers_to_read(monkeypatch: pytest.MonkeyPatch) -> None:
    text = 'Sure! Here it is:\n```json\n{"a": 1}\n```\nAnything else?'
    with ModelServer(replies(text)) as server:
        assert transport_to(server, monkeypatch).complete(ASK).text == text


@pytest.mark.parametrize("stream", [True, False])
def test_a_server_that_labels_or_streams_as_it_likes_is_understood(
    stream: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = b'{"choices": [{"message": {"content": [{"type": "text", "text": "in parts"}]}}]}'
    with ModelServer(Act(body=whole, content_type="text/plain")) as server:
        reply = transport_to(server, monkeypatch, stream=stream).complete(ASK)
    assert reply.text == "in parts"
    assert (reply.input_tokens, reply.output_tokens, reply.model) == (None, None, "small")


def test_what_a_server_packs_unasked_is_unpacked_up_to_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = [b'{"choices": [{"message": {"content": "%s"}}]}' % text for text in (b"packed", b"x" * 50_000_000)]
    acts = [Act(body=gzip.compress(answer), headers={"Content-Encoding": "gzip"}) for answer in answers]
    with ModelServer(*acts) as server:
        transport = transport_to(server, monkeypatch)
        assert transport.complete(ASK).text == "packed"
        with pytest.raises(ReplyTooLong):
            transport.complete(ASK)


def test_passing_failures_are_counted_and_then_over(monkeypatch: pytest.MonkeyPatch) -> None:
    acts = (fails(500), Act(reset=True), fails(429, retry_after="0"), replies("at last"))
    with ModelServer(*acts) as server:
        reply = transport_to(server, monkeypatch, retries=3).complete(ASK)
    assert (reply.text, reply.attempts, len(server.seen)) == ("at last", 4, 4)


def test_silence_ends_at_the_profiles_limit_and_nothing_is_sent_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was sent up to four times: a server that was at work on it may have charged for each."""
    with ModelServer(Act(wait_s=20), replies("awake")) as server:
        with pytest.raises(ModelTimeout, match="not sent again") as caught:
            transport_to(server, monkeypatch, timeout_s=0.5).complete(ASK)
        assert len(server.seen) == caught.value.attempts == 1


@pytest.mark.parametrize("status", [200, 307, 400, 500])
def test_an_answer_that_drips_ends_at_the_profiles_limit(status: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also one that only says what failed; no socket's timeout sees it, since each byte comes soon."""
    began = time.monotonic()
    with ModelServer(Act(status=status, body=b"x" * 10_000, drip_s=0.02)) as server, pytest.raises(ModelTimeout):
        transport_to(server, monkeypatch, timeout_s=0.3, retries=0).complete(ASK)
    # All of it would take 200 s; a busy machine takes its time, too.
    assert time.monotonic() - began < 100.0


@pytest.mark.parametrize("status", [200, 500])
def test_a_packed_answer_is_no_larger_than_the_bound(status: int, monkeypatch: pytest.MonkeyPatch) -> None:
    packed = gzip.compress(b"{" + b" " * 200_000_000)
    act = Act(status=status, body=packed, headers={"Content-Encoding": "gzip"})
    with ModelServer(act) as server:
        transport = transport_to(server, monkeypatch, retries=0)
        tracemalloc.start()
        try:
            with pytest.raises(ModelError):
                transport.complete(ASK)
            most = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    assert most < 20_000_000


@pytest.mark.parametrize("act", [Act(wait_s=20), replies("x" * 1000, drip_s=0.02)], ids=["silent", "dripping"])
def test_a_request_ends_at_its_own_limit(act: Act, monkeypatch: pytest.MonkeyPatch) -> None:
    with ModelServer(act) as server, pytest.raises(ModelTimeout, match=r"no whole reply within 0\.[23]"):
        transport_to(server, monkeypatch).complete(replace(ASK, timeout_s=0.3))
    assert len(server.seen) <= 1


def test_a_missing_server_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    with ModelServer() as server:
        transport = transport_to(server, monkeypatch)
    with pytest.raises(ModelUnavailable, match=r"no connection to the server at http://127\.0\.0\.1:\d+/v1"):
        transport.complete(ASK)


def test_a_proxy_that_cannot_be_used_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_PROXY")
    monkeypatch.setenv("HTTP_PROXY", "nonsense://proxy:1")
    with ModelServer() as server, pytest.raises(ModelConfigError, match="Check HTTP_PROXY and HTTPS_PROXY"):
        transport_to(server, monkeypatch).complete(ASK)


def test_ctrl_c_ends_a_request_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    main = threading.main_thread().ident
    assert main is not None

    def answer(_: object) -> Act:
        signal.pthread_kill(main, signal.SIGINT)
        return Act(wait_s=20)

    with ModelServer(decide=answer) as server, pytest.raises(KeyboardInterrupt):
        transport_to(server, monkeypatch).complete(ASK)
    assert len(server.seen) == 1


def test_many_threads_share_a_transport(monkeypatch: pytest.MonkeyPatch) -> None:
    def answer(seen: Any) -> Act:
        return replies(seen.texts[-1])

    got: dict[int, str] = {}
    with ModelServer(decide=answer) as server:
        transport = transport_to(server, monkeypatch)

        def ask(number: int) -> None:
            got[number] = transport.complete(ChatRequest.of("", f"say {number}")).text

        threads = [threading.Thread(target=ask, args=(number,)) for number in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(timeout=30)
    assert got == {number: f"say {number}" for number in range(8)}


def test_a_missing_library_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "openai", None)
    with ModelServer() as server, pytest.raises(ModelConfigError, match=r"pip install -e '\.\[llm\]'"):
        OpenAITransport(profile_of(server))


@pytest.mark.parametrize("name", BAD_PICTURES)
def test_a_picture_that_nobody_can_look_at_is_not_sent(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    data, word = BAD_PICTURES[name]
    request = ChatRequest("", (Message(("What is there?", Image(PNG), Image(data))),))
    with ModelServer(replies("nothing")) as server:
        with pytest.raises(RequestError, match=f"picture 2 of 2 .*{word}"):
            transport_to(server, monkeypatch).complete(request)
        assert not server.seen
