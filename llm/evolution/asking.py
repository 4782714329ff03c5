"""What the Inspector and the Supervisor of one model share: who is asked, how often, and where it is kept."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from llm.answers.ask import Log, ask
from llm.answers.base import Answer
from llm.answers.conversation import REPLY_LIMIT, AnswersRefused, Conversation
from llm.answers.prompting import Prompt, render
from llm.errors import CassetteError, ModelCancelled, ModelConfigError, ModelError
from llm.wire.transport import Image, Transport
from oag import Diagnostic

Given = TypeVar("Given", bound=Answer)
ROUNDS = 3
_SYSTEM = "evolution/evolution_system"


@dataclass(frozen=True, slots=True)
class NoAnswer:
    """Nothing usable was said.

    Attributes:
        reason: Why, in a sentence or two.
    """

    reason: str


@dataclass(slots=True)
class Asking:
    """Asks one model, and remembers when there is no more to be had of it.

    A model that does not answer ends an evolution, but does not throw away what was done: the reason goes into the
    story, and nothing more is asked.

    Attributes:
        transport: Who answers; it also keeps the budget.
        conversation: Every round goes in here.
        rounds: Most questions for one answer.
        stopped: Why nothing is asked any more; empty while all is well.
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
        schema: type[Given],
        check: Callable[[Given], Iterable[Diagnostic]],
        images: Sequence[Image] = (),
    ) -> Given | NoAnswer:
        """Returns an answer in which `check` finds nothing wrong, or why there is none.

        Args:
            module: `llm.answers.conversation.INSPECTOR` or `SUPERVISOR`.
            text: The question with its data.
            schema: The answer's form.
            check: Returns what is wrong with an answer of that form.
            images: Pictures that go with it.

        Raises:
            ModelConfigError, CassetteError, ModelCancelled: What only the caller can mend, or wanted.
        """
        if self.stopped:
            return NoAnswer(self.stopped)
        # Sections that have nothing to say leave blank lines.
        prompt = Prompt(module, render(_SYSTEM), re.sub(r"\n{3,}", "\n\n", text), tuple(images))
        try:
            return ask(self.transport, prompt, schema, check, rounds=self.rounds, log=self._log)
        except AnswersRefused as refusal:
            last = "; ".join(found.message for found in refusal.findings[:3])
            cut_off = any(found.code == "answer/cut-off" for found in refusal.findings)
            advice = f". {REPLY_LIMIT}" if cut_off else ""
            return NoAnswer(f"no answer held in {self.rounds} rounds; the last one: {last}{advice}")
        except (ModelConfigError, CassetteError, ModelCancelled):
            raise
        except ModelError as error:
            # Without the usage, so that a replay tells the same story.
            self.stopped = f"{error.model}: {error.problem}"
            return NoAnswer(self.stopped)
