"""The record of everything that was asked of a model for one proposal: each round, and each verdict on the plan."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from types import MappingProxyType

from bddl.visible import visible
from llm.errors import LlmError, shown_query
from oag import Diagnostic
from oag.model.diagnostic import Severity

INSPECTOR, SUPERVISOR, SPOTTER = 6, 7, 8
_NAMES: Mapping[int, str] = MappingProxyType(
    {INSPECTOR: "the inspector", SUPERVISOR: "the supervisor", SPOTTER: "the spotter"}
)


def asker(module: int) -> str:
    """Returns what people call the one who asks: "module 3", "the inspector", "the supervisor" or "the spotter"."""
    return _NAMES.get(module, f"module {module}")


@dataclass(frozen=True, slots=True)
class Round:
    """One question to a model and what became of its answer.

    Attributes:
        module: Which module asked, 1 to 5, or INSPECTOR, SUPERVISOR, or SPOTTER.
        number: Counts the rounds of the conversation, from 1.
        request_sha256: Digest of the request (`ChatRequest.digest`), under which a recording has it.
        prompt_sha256: Digest of the module's prompt, without earlier answers.
        reply: What the model replied, as it is.
        findings: What was found wrong; warnings are asked about once.
        accepted: True when the module took the answer.
        finish_reason: Why the model stopped.
        input_tokens: As the server counted them, or None.
        output_tokens: As the server counted them, or None.
        latency_s: Seconds until the reply was there.
        recorded: Whether it came out of a recording, and was not paid again.
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

    def to_json(self) -> dict[str, object]:
        """Returns the round as JSON values."""
        return {"kind": "round"} | _members(self)


@dataclass(frozen=True, slots=True)
class PlanVerdict:
    """What the graph decided of the answers taken together.

    Attributes:
        verdict: PROVED, CONDITIONAL or REFUTED.
        searched: True when the flows were not asked for yet, and a search supplied them for this decision.
        blamed: The module that was asked again, or None.
        findings: What it was told.
    """

    verdict: str
    searched: bool
    blamed: int | None = None
    findings: tuple[Diagnostic, ...] = ()

    def to_json(self) -> dict[str, object]:
        """Returns the verdict as JSON values."""
        return {"kind": "verdict"} | _members(self)


def _members(entry: Round | PlanVerdict) -> dict[str, object]:
    written = {item.name: getattr(entry, item.name) for item in fields(entry)}
    return written | {"findings": [found.to_json() for found in entry.findings]}


@dataclass(slots=True)
class Conversation:
    """What was said between this package and one model about one query, in order.

    Attributes:
        model: Which model, as it was configured.
        query: The user's query.
        scene: The scene's name.
        entries: Rounds and verdicts.
        listen: Gets every round when its answer has been judged.
    """

    model: str
    query: str
    scene: str
    entries: list[Round | PlanVerdict] = field(default_factory=list)
    listen: Callable[[Round], None] | None = field(default=None, compare=False, repr=False)

    def add(self, entry: Round) -> None:
        """Keep a round, and tell it."""
        self.entries.append(entry)
        if self.listen is not None:
            self.listen(entry)

    @property
    def rounds(self) -> tuple[Round, ...]:
        """The questions, without the verdicts between them."""
        return tuple(entry for entry in self.entries if isinstance(entry, Round))

    @property
    def tokens(self) -> tuple[int, int]:
        """Input and output tokens of all rounds, as far as the server counted them."""
        counted = [(entry.input_tokens or 0, entry.output_tokens or 0) for entry in self.rounds]
        return sum(first for first, _ in counted), sum(second for _, second in counted)

    def to_json(self) -> dict[str, object]:
        """Returns the whole record as JSON values; documented in docs/modules.md."""
        return {
            "schema": "scene2demo/conversation/1",
            "model": self.model,
            "query": self.query,
            "scene": self.scene,
            "entries": [entry.to_json() for entry in self.entries],
        }

    def story(self) -> str:
        """Returns one line for each entry, for messages."""
        lines = []
        for entry in self.entries:
            codes = ", ".join(dict.fromkeys(found.code for found in entry.findings))
            if isinstance(entry, Round):
                outcome = "accepted" if entry.accepted else "refused"
                said = f": {codes}" if codes else ""
                lines.append(f"  round {entry.number}  {asker(entry.module)}  {outcome}{said}")
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
    """Returns a finding about an answer, a `Diagnostic` like those about plans: a model is told all in one form.

    Its code is listed in docs/modules.md, or one of `oag`'s own.
    """
    return Diagnostic(code, severity, message, place, subtask, hint=hint)


def said_by(found: Diagnostic) -> tuple[str, ...]:
    """Returns what makes a finding the same as another one: what it says, about what, and where."""
    return (found.code, found.place, found.literal or "", found.message)


def errors_of(findings: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Returns the findings with which an answer cannot be used."""
    return tuple(found for found in findings if found.severity == "error")


REPLY_LIMIT = (
    "The limit of a single reply is max_tokens in a file of profiles (docs/models.md), or the server's own. "
    "--max-tokens is the budget of the whole run"
)
"""What to do about replies that end too early; thinking counts as well."""


class AnswersRefused(LlmError):
    """A model gave no usable answer in the rounds that it had; everything that was said is kept.

    Attributes:
        conversation: Every round and every verdict.
        module: Which module got no answer, 1 to 5, or `llm.answers.conversation.INSPECTOR`, `SUPERVISOR`, or
            `SPOTTER`.
        findings: What was wrong with the last answer.
        insists: True when the model kept giving an answer that had been refused.
    """

    def __init__(
        self, conversation: Conversation, module: int, findings: Sequence[Diagnostic], *, insists: bool = False
    ) -> None:
        rounds = len(conversation.rounds)
        count = "1 round" if rounds == 1 else f"{rounds} rounds"
        why = f"{conversation.model} repeats a refused answer to" if insists else f"{conversation.model} does not solve"
        problem = f"{why} {asker(module)} in {count} (query: {shown_query(conversation.query)!r})"
        last = "\n".join(f"  {line}" for found in findings for line in str(found).splitlines())
        advice = (REPLY_LIMIT,) if any(found.code == "answer/cut-off" for found in findings) else ()
        said = "\n".join((problem, conversation.story(), "the last answer:", last, *advice))
        super().__init__(visible(said))
        self.conversation = conversation
        self.module = module
        self.findings = tuple(findings)
        self.insists = insists
