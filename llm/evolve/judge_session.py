"""The session with a model that judges attempts; Inspector and Supervisor share it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from llm.client.transport import Part, Transport
from llm.errors import CassetteError, ModelConfigError, ModelError
from llm.structured.ask import Log, ask
from llm.structured.conversation import (
    REPLY_LIMIT,
    AnswersRefused,
    Conversation,
)
from llm.structured.prompting import Prompt, render
from llm.structured.schema import (
    Answer,
)
from oag import (
    Diagnostic,
)

AnswerT = TypeVar("AnswerT", bound=Answer)
ROUNDS = 3
ALL_VIEWS = ("global", "head", "wrist")
_SYSTEM = "evolve/system"


@dataclass(slots=True)
class JudgeSession:
    """Session with one model; it stops asking after the model has failed.

    A model without a reply ends an evolution but does not discard its results: the reason goes into the record, and
    nothing more is asked.

    Attributes:
        transport: Transport to the model; it also keeps the budget.
        conversation: Record of every round.
        rounds: Most questions for one answer.
        stopped: Why the model is no longer asked; empty while it is.
    """

    transport: Transport
    conversation: Conversation
    rounds: int = ROUNDS
    stopped: str = ""
    _log: Log = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._log = Log(self.conversation)

    def ask(
        self,
        module: int,
        text: str,
        schema: type[AnswerT],
        check: Callable[[AnswerT], Iterable[Diagnostic]],
        images: Sequence[Part] = (),
    ) -> AnswerT | str:
        """Return an answer in which `check` finds nothing wrong, or in a sentence or two why there is none.

        Raises:
            ModelConfigError, CassetteError: Failures that only the caller can fix.
        """
        if self.stopped:
            return self.stopped
        # Empty sections leave blank lines.
        prompt = Prompt(module, render(_SYSTEM), re.sub(r"\n{3,}", "\n\n", text), tuple(images))
        try:
            return ask(self.transport, prompt, schema, check, rounds=self.rounds, log=self._log)
        except AnswersRefused as refusal:
            last = "; ".join(found.message for found in refusal.findings[:3])
            cut_off = any(found.code == "answer/cut-off" for found in refusal.findings)
            advice = f". {REPLY_LIMIT}" if cut_off else ""
            return f"no answer held in {self.rounds} rounds; the last one: {last}{advice}"
        except (ModelConfigError, CassetteError):
            raise
        except ModelError as error:
            # Without the usage, so that a replay gives the same record.
            self.stopped = f"{error.model}: {error.problem}"
            return self.stopped
