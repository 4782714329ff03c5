"""No body, however strange, is more than a completion with text or a failure with words."""

from __future__ import annotations

import json
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from llm.client.completion import Unanswered, error_message, read_answer
from llm.client.transport import ChatReply
from llm.errors import ModelError

VALUES: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(
                ["choices", "message", "delta", "content", "text", "usage", "error", "finish_reason", "model",
                 "prompt_tokens", "completion_tokens", "refusal", "type"]
            ),
            inner,
            max_size=4,
        )
    ),
    max_leaves=12,
)  # fmt: skip


def is_sound(outcome: ChatReply | Unanswered) -> bool:
    """Return whether an outcome keeps its promises."""
    if isinstance(outcome, Unanswered):
        return issubclass(outcome.kind, ModelError) and bool(outcome.problem)
    counts = (outcome.input_tokens, outcome.output_tokens)
    return isinstance(outcome.text, str) and all(count is None or count >= 0 for count in counts)


@given(st.binary(max_size=80), st.text(max_size=20))
@settings(max_examples=300)
def test_any_bytes_have_an_outcome(body: bytes, content_type: str) -> None:
    assert is_sound(read_answer(body, content_type))
    assert is_sound(read_answer(b"data:" + body, content_type))
    assert "\n" not in error_message(body)


@given(VALUES, st.lists(VALUES, max_size=4), st.sampled_from(["\n\n", "\r\n\r\n"]))
@settings(max_examples=100)
def test_any_json_has_an_outcome(value: Any, values: list[Any], end: str) -> None:
    assert is_sound(read_answer(json.dumps(value).encode(), "application/json"))
    for name in ("message", "delta"):
        assert is_sound(read_answer(json.dumps({"choices": [{name: value}]}).encode(), "application/json"))
    events = "".join(f"data: {json.dumps(item)}{end}" for item in [value, *values])
    assert is_sound(read_answer(events.encode(), "text/event-stream"))
    assert isinstance(error_message(json.dumps(value).encode()), str)


@given(st.text(min_size=1, max_size=60), st.integers(1, 9), st.sampled_from(["\n", "\r\n"]))
def test_a_text_survives_being_streamed_in_any_pieces(text: str, size: int, end: str) -> None:
    pieces = [text[start : start + size] for start in range(0, len(text), size)]
    events = [{"choices": [{"delta": {"content": piece}}]} for piece in pieces]
    events.append({"choices": [{"delta": {}, "finish_reason": "stop"}], "model": "m"})
    events.append({"choices": [], "usage": {"prompt_tokens": 3, "completion_tokens": 4}, "model": "m"})
    body = ": hello" + end * 2 + "".join(f"data: {json.dumps(event)}{end * 2}" for event in events) + "data: [DONE]"
    assert read_answer(body.encode(), "text/event-stream") == ChatReply(text, 3, 4, finish_reason="stop", model="m")
