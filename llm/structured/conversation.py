"""Record of the exchanges with a model: each round, each verdict on the plan, and what the rounds cost."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from types import MappingProxyType

from bddl.terminal import escape_control
from llm.client.budget import Metered
from llm.client.transport import project_version
from llm.errors import LlmError, shown_query
from oag import Diagnostic
from oag.model.diagnostics import Severity

INSPECTOR, SUPERVISOR, SPOTTER = 6, 7, 8
_NAMES: Mapping[int, str] = MappingProxyType(
    {INSPECTOR: "the inspector", SUPERVISOR: "the supervisor", SPOTTER: "the spotter"}
)
MODULES: Mapping[str, int] = MappingProxyType(
    {**{str(n): n for n in range(1, 6)}, **{name.removeprefix("the "): n for n, name in _NAMES.items()}}
)
"""Name of whoever asks a model, as options have it -> number."""


def asker(module: int) -> str:
    """Return the name of the asking role: "module 3", "the inspector", "the supervisor" or "the spotter"."""
    return _NAMES.get(module, f"module {module}")


@dataclass(frozen=True, slots=True)
class Round:
    """One question to a model and the result of its answer.

    Attributes:
        module: The asking module, 1 to 5, or INSPECTOR, SUPERVISOR, or SPOTTER.
        number: Number of the round in the conversation, from 1.
        request_sha256: Digest of the request (`ChatRequest.digest`), its key in a recording.
        prompt_sha256: Digest of the module's prompt, without earlier answers.
        reply: The model's reply, unchanged.
        findings: The findings about it; warnings are asked about once.
        accepted: True when the module took the answer.
        finish_reason: Why the model stopped.
        input_tokens: As counted by the server, or None.
        output_tokens: As counted by the server, or None.
        latency_s: Time until the reply [s].
        recorded: Whether it came from a recording, and was not paid again.
        attempts: How often the request was sent.
        template_sha256: Digest of the templates of the prompt; prompts with other data have the same.
    """

    module: int
    number: int
    request_sha256: str
    prompt_sha256: str
    reply: str
    findings: tuple[Diagnostic, ...]
    accepted: bool
    finish_reason: str = "stop"
    input_tokens: int | None = None
    output_tokens: int | None = None
    latency_s: float = 0.0
    recorded: bool = field(default=False, compare=False, repr=False)
    attempts: int = 1
    template_sha256: str = ""


@dataclass(frozen=True, slots=True)
class PlanVerdict:
    """Verdict of the graph on all answers together.

    Attributes:
        verdict: PROVED, CONDITIONAL or REFUTED; UNDECIDED where a module found no answer to the plan so far.
        searched: True when a search supplied the flows, before they were requested from the model.
        blamed: The module that was asked again, or None.
        findings: The findings sent to it.
    """

    verdict: str
    searched: bool
    blamed: int | None = None
    findings: tuple[Diagnostic, ...] = ()


def _entry_json(entry: Round | PlanVerdict) -> dict[str, object]:
    kind = "round" if isinstance(entry, Round) else "verdict"
    written = {item.name: getattr(entry, item.name) for item in fields(entry)}
    return {"kind": kind, **written, "findings": [found.to_json() for found in entry.findings]}


@dataclass(slots=True)
class Conversation:
    """Exchanges with one model about one query, in order.

    Attributes:
        model: The model as configured.
        query: The user's query.
        scene: The scene's name.
        entries: Rounds and verdicts.
        listen: Called with every round after its answer was checked.
    """

    model: str
    query: str
    scene: str
    entries: list[Round | PlanVerdict] = field(default_factory=list)
    listen: Callable[[Round], None] | None = field(default=None, compare=False, repr=False)

    def add(self, entry: Round) -> None:
        """Append a round and pass it to `listen`."""
        self.entries.append(entry)
        if self.listen is not None:
            self.listen(entry)

    @property
    def rounds(self) -> tuple[Round, ...]:
        """The questions, without the verdicts between them."""
        return tuple(entry for entry in self.entries if isinstance(entry, Round))

    def to_json(self) -> dict[str, object]:
        """Return the whole record as JSON values; documented in docs/models.md."""
        return {
            "schema": "scene2demo/conversation/1",
            "version": project_version(),
            "model": self.model,
            "query": self.query,
            "scene": self.scene,
            "entries": [_entry_json(entry) for entry in self.entries],
        }

    def story(self) -> str:
        """Return one line for each entry, for messages."""
        lines = []
        for entry in self.entries:
            codes = ", ".join(dict.fromkeys(found.code for found in entry.findings))
            if isinstance(entry, Round):
                outcome = "accepted" if entry.accepted else "refused"
                listed = f": {codes}" if codes else ""
                lines.append(f"  round {entry.number}  {asker(entry.module)}  {outcome}{listed}")
            else:
                again = f", {asker(entry.blamed)} asked again: {codes}" if entry.blamed else ""
                lines.append(f"  verdict  {entry.verdict}{again}")
        return "\n".join(lines)


def finding(
    code: str,
    message: str,
    place: str = "",
    *,
    subtask: int | None = None,
    hint: str | None = None,
    severity: Severity = "error",
) -> Diagnostic:
    """Return a finding about an answer: a `Diagnostic` like those about plans, so that a model reads one form only.

    Its code is listed in docs/models.md, or one of `oag`'s own.
    """
    return Diagnostic(code, severity, message, place, subtask, hint=hint)


def finding_key(found: Diagnostic) -> tuple[str, ...]:
    """Return the identity of a finding: its code, place, literal and message."""
    return (found.code, found.place, found.literal or "", found.message)


def errors_of(findings: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Return the findings that make an answer unusable."""
    return tuple(found for found in findings if found.severity == "error")


def entries_of(findings: Iterable[Diagnostic]) -> tuple[int, ...]:
    """Return the numbers of the subtasks that errors are about; empty if one is about the whole answer."""
    numbers = [found.subtask for found in errors_of(findings)]
    return tuple(sorted({number + 1 for number in numbers if number is not None})) if None not in numbers else ()


REPLY_LIMIT = (
    "The limit of a single reply is max_tokens in a file of profiles (docs/models.md), or the server's own. "
    "--max-tokens is the budget of the whole run"
)
"""Advice for truncated replies; thinking counts as well."""


class AnswersRefused(LlmError):
    """A model gave no usable answer in the allowed rounds; the conversation is kept.

    Attributes:
        conversation: Every round and every verdict.
        module: The module without an answer, 1 to 5, or `llm.structured.conversation.INSPECTOR`, `SUPERVISOR`, or
            `SPOTTER`.
        findings: The findings about the last answer.
        insists: True when the model repeated an answer that had been refused.
    """

    exit_code = 1

    def __init__(
        self, conversation: Conversation, module: int, findings: Sequence[Diagnostic], *, insists: bool = False
    ) -> None:
        rounds = len(conversation.rounds)
        count = "1 round" if rounds == 1 else f"{rounds} rounds"
        why = f"{conversation.model} repeats a refused answer to" if insists else f"{conversation.model} does not solve"
        problem = f"{why} {asker(module)} in {count} (query: {shown_query(conversation.query)!r})"
        last = "\n".join(f"  {line}" for found in findings for line in str(found).splitlines())
        advice = (REPLY_LIMIT,) if any(found.code == "answer/cut-off" for found in findings) else ()
        message = "\n".join((problem, conversation.story(), "the last answer:", last, *advice))
        super().__init__(escape_control(message))
        self.conversation = conversation
        self.module = module
        self.findings = tuple(findings)
        self.insists = insists


@dataclass(slots=True)
class Spending:
    """Rounds of a run with their costs; `add_round` is the listener of whoever asks the model.

    Attributes:
        model: The model, with its usage and its price.
        tell: Called with a line for each round after its answer was checked.
        rounds: Every round until now.
    """

    model: Metered
    tell: Callable[[str], None] = lambda line: None
    rounds: list[Round] = field(default_factory=list)
    _asked: Counter[int] = field(default_factory=Counter)

    def add_round(self, entry: Round) -> None:
        """Append a round and report it."""
        self.rounds.append(entry)
        self._asked[entry.module] += 1
        self.tell(", ".join((f"{asker(entry.module)}, round {self._asked[entry.module]}", *self.numbers(entry))))

    def cost_usd(self, entry: Round) -> float | None:
        """Return the cost of a round by list price [US dollars]; None if price or tokens are unknown."""
        price, tokens = self.model.price_of(entry.module), (entry.input_tokens, entry.output_tokens)
        if price is None or tokens[0] is None or tokens[1] is None:
            return None
        return price.cost_usd(tokens[0], tokens[1])

    def numbers(self, entry: Round) -> tuple[str, str, str]:
        """Return a round's duration, tokens and cost as texts."""
        tokens = "tokens not counted"
        if entry.input_tokens is not None and entry.output_tokens is not None:
            tokens = f"{entry.input_tokens} + {entry.output_tokens} tokens"
        cost_usd = self.cost_usd(entry)
        cost = "price unknown" if self.model.price_of(entry.module) is None else "cost unknown"
        if cost_usd is not None:
            cost = f"${cost_usd:.4f}"
        if entry.recorded:
            cost = f"{cost}, paid before" if cost_usd else "recorded, not paid again"
        sent = f" (sent {entry.attempts} times)" if entry.attempts > 1 else ""
        return f"{entry.latency_s:.1f} s{sent}", tokens, cost

    def rows(self) -> list[tuple[str, str, str, str, str]]:
        """Return a row for each round: the asking role, its number, and its numbers."""
        asked = Counter[int]()
        rows = []
        for entry in self.rounds:
            asked[entry.module] += 1
            rows.append((asker(entry.module), str(asked[entry.module]), *self.numbers(entry)))
        return rows

    def total(self) -> str:
        """Return the totals in one line."""
        price = self.model.price
        dated = f" (list prices of {price.date})" if price is not None and price.date else ""
        return f"{self.model.name}: {self.model.usage.summary()}{dated}"

    def to_json(self) -> dict[str, object]:
        """Return totals and rounds as JSON values."""
        price = self.model.price
        return {
            "model": self.model.name,
            "price": None if price is None else price.model_dump(),
            **self.model.usage.record(),
            "rounds": [
                {
                    "asked_by": who,
                    "round": int(number),
                    "seconds": entry.latency_s,
                    "input_tokens": entry.input_tokens,
                    "output_tokens": entry.output_tokens,
                    "cost_usd": self.cost_usd(entry),
                    "recorded": entry.recorded,
                    "attempts": entry.attempts,
                    "accepted": entry.accepted,
                }
                for (who, number, *_), entry in zip(self.rows(), self.rounds, strict=True)
            ],
        }
