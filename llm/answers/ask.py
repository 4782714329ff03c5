"""Asking a model until its answer holds: schema, then check, then the numbered findings back to it, boundedly often.

Errors make an answer unusable. A warning is asked about once: an answer that stays as it is was meant so.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from pydantic import ValidationError

from llm.answers.base import Answer, wire_schema
from llm.answers.conversation import AnswersRefused, Conversation, Round, errors_of, finding, said_by
from llm.answers.extract import extract
from llm.answers.prompting import Prompt, Refused, summary
from llm.wire.transport import ChatReply, Transport
from oag import CODES, Diagnostic

Given = TypeVar("Given", bound=Answer)
# An answer that comes back unchanged so often will not change any more.
MOST_REPEATS = 2
_MOST_FIELD_ERRORS = 12


@dataclass(slots=True)
class Log:
    """What `ask` keeps of a conversation: the record, and which answers were refused.

    Attributes:
        conversation: Every round goes in here.
        refused: For each prompt and answer that was refused: the round, and what was wrong.
    """

    conversation: Conversation
    refused: dict[tuple[str, str], tuple[int, tuple[Diagnostic, ...]]] = field(default_factory=dict)

    def refuse(self, prompt: Prompt, answer: Answer, findings: Sequence[Diagnostic]) -> None:
        """Notes that an answer to a prompt is wrong, so that it is not taken when it comes again."""
        number = len(self.conversation.rounds)
        self.refused.setdefault((prompt.sha256, _key(answer)), (number, tuple(findings)))


def ask(
    transport: Transport,
    prompt: Prompt,
    schema: type[Given],
    check: Callable[[Given], Iterable[Diagnostic]],
    *,
    rounds: int,
    log: Log,
    objection: Refused | None = None,
) -> Given:
    """Returns an answer that has the schema's form and in which `check` finds nothing wrong.

    Args:
        transport: Who answers; it also keeps the budget, and stops when it is spent or the caller cancels.
        prompt: What is asked.
        schema: The answer's form.
        check: Returns what is wrong with an answer of that form: errors refuse it, warnings are asked about once.
        rounds: Most questions to the model, at least 1.
        log: Where every round is kept.
        objection: An earlier answer to this prompt with what was found wrong with it since.

    Raises:
        AnswersRefused: No answer held, with the whole story.
        ModelError: The model did not reply, the budget is spent, or the caller cancelled.
    """
    wire = wire_schema(schema)
    refused, doubts, before, repeats = objection, set[tuple[str, ...]](), list[str](), 0
    fallback: Given | None = None
    findings: tuple[Diagnostic, ...] = () if objection is None else objection.findings
    for _ in range(max(rounds, 1)):
        request = prompt.request(wire, refused)
        reply = transport.complete(request)
        answer, findings = _judged(reply, schema, check)
        earlier = None if answer is None else log.refused.get((prompt.sha256, _key(answer)))
        if earlier is not None:
            again = f"this is the answer of round {earlier[0]} again, and it is wrong for the same reasons"
            hint = "change what the points below name; an unchanged answer cannot be used"
            findings = (finding("answer/repeated", again, "reply", hint=hint), *earlier[1])
            repeats += 1
        errors = errors_of(findings)
        news = {said_by(found) for found in findings} - doubts
        accepted = answer is not None and not errors and not news
        log.conversation.add(
            Round(
                module=prompt.module,
                number=len(log.conversation.rounds) + 1,
                request_sha256=request.digest(),
                prompt_sha256=prompt.sha256,
                reply=reply.text,
                findings=findings,
                accepted=accepted,
                finish_reason=reply.finish_reason,
                input_tokens=reply.input_tokens,
                output_tokens=reply.output_tokens,
                latency_s=reply.latency_s,
                recorded=reply.recorded,
            )
        )
        if answer is not None and not errors:
            fallback = answer
            if accepted:
                return answer
            doubts |= news
        elif answer is not None and earlier is None:
            log.refuse(prompt, answer, findings)
        if repeats >= MOST_REPEATS:
            break
        if refused is not None and refused is not objection:
            before.append(summary(refused.findings))
        refused = Refused(reply.text, findings, tuple(dict.fromkeys(before)))
    if fallback is not None:
        return fallback
    raise AnswersRefused(log.conversation, prompt.module, findings, insists=repeats >= MOST_REPEATS)


def _judged(
    reply: ChatReply, schema: type[Given], check: Callable[[Given], Iterable[Diagnostic]]
) -> tuple[Given | None, tuple[Diagnostic, ...]]:
    """Returns the answer in a reply, None when it has none of the schema's form, and what is wrong."""
    found = extract(reply.text, schema.found_in, cut_off=reply.finish_reason == "length")
    if isinstance(found, Diagnostic):
        return None, (found,)
    try:
        answer = schema.model_validate(found)
    except ValidationError as problem:
        listed = problem.errors(include_url=False, include_context=False, include_input=True)
        wrong = [_field_finding(error) for error in listed[:_MOST_FIELD_ERRORS]]
        if len(listed) > len(wrong):
            wrong.append(finding("answer/field", f"and {len(listed) - len(wrong)} fields more are wrong", "reply"))
        return None, tuple(wrong)
    except RecursionError:
        return None, (finding("answer/field", "the object is nested too deeply", "reply"),)
    return answer, tuple(check(answer))


def _field_finding(error: Mapping[str, object]) -> Diagnostic:
    kind, message, location = str(error["type"]), str(error["msg"]), error["loc"]
    parts = location if isinstance(location, tuple) else ()
    place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).removeprefix(".")
    if kind in CODES:
        return Diagnostic(kind, "error", message, place or "reply")
    given = "" if kind == "missing" else f", got {_quoted(error.get('input'))}"
    said = message[:1].lower() + message[1:]
    return finding("answer/field", f"{said}{given}", place or "reply")


def _quoted(value: object) -> str:
    if isinstance(value, dict | list):
        return f"{'an object' if isinstance(value, dict) else 'a list'} of {len(value)}"
    if isinstance(value, int) and abs(value) >= 10**20:
        return "a huge integer"
    shown = ascii(value)
    return shown if len(shown) <= 60 else f"{shown[:57]}..."


def _key(answer: Answer) -> str:
    return json.dumps(answer.model_dump(), sort_keys=True)
