"""A server whose model judges and revises by script, and the command line pointed to it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

import pytest

from tests.llm.evolve.scripted_judges import asked_step, critique_answer
from tests.llm.live import KEY, KEY_VARIABLE
from tests.llm.model_server import Act, ModelServer, Seen, replies

MODEL = "openai-compatible:judge"


def judging_server(revision: Mapping[str, Any], faulty: Callable[[str, int], bool]) -> ModelServer:
    """Return a server that answers as `judge` does."""
    return ModelServer(decide=judge(revision, faulty), key=KEY)


def judge(revision: Mapping[str, Any], faulty: Callable[[str, int], bool]) -> Callable[[Seen], Act]:
    """Return what finds fault with some steps, and always answers with one revision.

    Args:
        revision: The Supervisor's answer.
        faulty: Decides by the Inspector's question and the step's number, from 1.
    """

    def decide(seen: Seen) -> Act:
        text = "\n".join(seen.texts)
        if "Inspector: judge" not in text:
            return replies(json.dumps(revision))
        step = asked_step(text)
        return replies(json.dumps(critique_answer(step, state_reached="no" if faulty(text, step) else "unclear")))

    return decide


def point_to(server: ModelServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the command line of this process, and those that it starts, talk to a server on this machine."""
    monkeypatch.setenv("SCENE2DEMO_MODEL_URL", server.address)
    monkeypatch.setenv(KEY_VARIABLE, KEY)
