"""A model that answers from a list, for tests of what stands in front of a model."""

from __future__ import annotations

from llm.client.transport import ChatReply, ChatRequest
from llm.errors import ModelError


class Scripted:
    """Gives its outcomes one after the other; the last one stays."""

    def __init__(self, *outcomes: ChatReply | ModelError | str) -> None:
        self.asked: list[ChatRequest] = []
        self._outcomes = outcomes or (ChatReply("fine", 10, 5, 0.25),)

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return or raises the next outcome."""
        outcome = self._outcomes[min(len(self.asked), len(self._outcomes) - 1)]
        self.asked.append(request)
        if isinstance(outcome, ModelError):
            raise outcome
        return ChatReply(outcome, 10, 5, 0.25) if isinstance(outcome, str) else outcome
