"""Ask a model until its answer is valid: extract the JSON, validate it, check it, return the findings.

The number of rounds is bounded.

The JSON answer may stand among prose, code fences, thoughts and drafts. Nothing is executed. A text that is nearly JSON
is read where it has one reading (`llm.structured.lenient`); otherwise it is a finding with its place. Errors make an
answer unusable. A warning is asked about once: an answer that stays the same was intended.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TypeVar

from pydantic import ValidationError

from llm.client.transport import ChatReply, ChatRequest, Transport
from llm.structured import lenient
from llm.structured.conversation import AnswersRefused, Conversation, Round, entries_of, errors_of, finding, finding_key
from llm.structured.prompting import Prompt, Refused, summary
from llm.structured.schema import ANYTHING, Admitted, Answer, wire_schema
from oag import Diagnostic
from oag.model.codec import STRICT
from oag.model.diagnostics import CODES

# Limit of reading, longer than any answer.
LONGEST_REPLY = 400_000
# Most opening brackets tried before a text counts as one without JSON; and of these, most that are read leniently.
_MOST_STARTS = 2_000
_MOST_LENIENT = 12
_LONGEST_QUOTED = 60
# Possible beginning of an object or a list of objects, in JSON or in attempted JSON; a brace in prose does not match.
# A name that lacks a quote, or has another character in its place, still counts as a name.
_OPENING = re.compile(
    r"""\{(?=\s*(?:["'\u201c\u201d\u2018\u2019}]|//|/\*|[^\w\s{}\[\]]?[A-Za-z_]\w*[^\w\s{}\[\]:]?\s*:))|\[(?=\s*\{)"""
)
# Continues where STRICT refuses, to find the end of the value.
_LENIENT = json.JSONDecoder(parse_int=str)
_AnswerIn = Callable[[object], dict[str, object] | None]


def extract(
    text: str, answer_in: _AnswerIn, *, cut_off: bool = False, fields: Collection[str] = ()
) -> dict[str, object] | Diagnostic:
    """Return the last answer in a reply, or the finding that explains why there is none.

    A model that writes a draft writes the answer after it. So an unreadable object after the answer is a finding,
    and the earlier object is not used in its place.

    Args:
        text: The reply.
        answer_in: Returns the answer that a JSON object or list is or wraps, or None.
        cut_off: True when the model stopped at its limit of tokens.
        fields: Fields of an answer: one without its last brace counts only if it has all of them.

    Returns:
        The answer; without one the first object, in which fields will be missing.
    """
    if len(text) > LONGEST_REPLY:
        long = f"the reply has {len(text)} characters; no answer needs more than {LONGEST_REPLY}"
        return finding("answer/too-long", long, "reply", hint="answer with the JSON object alone")
    whole, text = text, strip_thoughts(text.translate(lenient.INVISIBLE))
    answer: dict[str, object] | None = None
    others: list[dict[str, object]] = []
    broken: Diagnostic | None = None
    end = counted = unclosed = tries = 0
    for _ in range(_MOST_STARTS):
        opening = _OPENING.search(text, end)
        if opening is None:
            break
        start = opening.start()
        unclosed += text.count("{", counted, start) - text.count("}", counted, start)
        counted = start
        found, end, problem = _read(text, start)
        # An object inside a broken object is no answer.
        outside = broken is None or unclosed <= 0
        taken = answer_in(found) if outside else None
        if problem is not None and outside and tries < _MOST_LENIENT:
            tries += 1
            taken, end = _leniently(text, start, answer_in, () if cut_off else fields) or (None, end)
        if taken is not None:
            answer, broken = taken, None
        elif isinstance(found, dict):
            others.append(found)
        elif opening[0] == "[":
            # The elements of a list that is no answer are examined separately.
            end = opening.end()
        elif broken is None:
            broken, unclosed = problem, 0
    else:
        many = f"the reply has more than {_MOST_STARTS} pieces that look like objects"
        broken = finding("answer/broken-json", many, "reply", hint="answer with the JSON object alone")
    if answer is None and not cut_off:
        answer = _without_braces(text, answer_in, others if broken is None else ())
        broken = None if answer is not None else broken
    if answer is not None and broken is None:
        return answer
    if cut_off:
        message = "the reply was cut off at the limit of tokens before its JSON object ended"
        return finding("answer/cut-off", message, "reply", hint="answer more briefly, with the JSON object alone")
    return broken or (others[0] if others else _nothing(whole, text))


def _leniently(
    text: str, start: int, answer_in: _AnswerIn, fields: Collection[str]
) -> tuple[dict[str, object], int] | None:
    """Return the answer that begins at a position, and its end; without its last brace only if it has all `fields`."""
    whole = lenient.read_object(text, start)
    read = whole or (lenient.read_object(text, start, unclosed=True) if fields else None)
    answer = None if read is None else answer_in(read[0])
    if read is None or answer is None or (whole is None and any(name not in answer for name in fields)):
        return None
    return answer, read[1]


def _without_braces(text: str, answer_in: _AnswerIn, entries: Sequence[dict[str, object]]) -> dict[str, object] | None:
    """Return the answer of a text whose outer brackets are missing, that is YAML, or JSON within a JSON text."""
    found: list[object] = [list(entries)] if len(entries) > 1 else []
    found += [lenient.read_bare(text), lenient.read_yaml(text)]
    if text.strip().startswith('"{'):
        with suppress(ValueError, RecursionError):
            found.append(STRICT.decode(str(STRICT.decode(text.strip()))))
    return next((answer for value in found if (answer := answer_in(value)) is not None), None)


def _read(text: str, start: int) -> tuple[object, int, Diagnostic | None]:
    """Return the JSON value at a position, the position where reading ended, and the problem with it."""
    try:
        return *STRICT.raw_decode(text, start), None
    except json.JSONDecodeError as error:
        return None, max(error.pos, start + 1), _broken(text, start, error)
    except RecursionError:
        # No intended answer is nested so deeply, and searching inside would take long.
        return None, len(text), _unusable("it is nested too deeply")
    except ValueError as refusal:
        problem = _unusable(str(refusal).partition(":")[0])
    try:
        return None, _LENIENT.raw_decode(text, start)[1], problem
    except json.JSONDecodeError as error:
        return None, max(error.pos, start + 1), problem


def _unusable(problem: str) -> Diagnostic:
    return finding("answer/broken-json", f"the JSON cannot be used: {problem[:200]}", "reply")


def _broken(text: str, start: int, problem: json.JSONDecodeError) -> Diagnostic:
    line = text.count("\n", start, problem.pos) + 1
    piece = " ".join(text[max(start, problem.pos - 30) : problem.pos + 20].split())
    ended = not text[problem.pos : problem.pos + 1].strip() and not text[problem.pos :].strip()
    detail = "it ends before its last brace" if ended else f"{problem.msg} at its line {line}, near {piece!r}"
    return finding("answer/broken-json", f"the JSON object cannot be read: {detail}", "reply")


def _nothing(whole: str, text: str) -> Diagnostic:
    start = text.find("{")
    if start >= 0:
        _, _, problem = _read(text, start)
        if problem is not None:
            return problem
    hint = "answer with one JSON object that has the fields named above, and nothing else"
    begins = " ".join(text[: 4 * _LONGEST_QUOTED].split())[:_LONGEST_QUOTED]
    if begins:
        message = f"the reply holds no JSON object; it begins {begins!r}"
    elif whole.strip():
        message = "the reply holds thoughts, and no JSON object after them"
    else:
        message = "the reply is empty: it holds no JSON object"
    return finding("answer/no-json", message, "reply", hint=hint)


# One pass over fixed words: the time is linear in the length of any reply.
_MARK = re.compile(
    r"<(?:/?)(?:[a-z]{1,12}:)?(?:think|thinking|thoughts?|reasoning|reflection|scratchpad|analysis)(?:\s[^<>]{0,80})?>"
    r"|\[/?think\]|◁/?think▷|<\|(?:begin|end)_of_thought\|>|<\|(?:start|end)_thinking\|>",
    re.IGNORECASE,
)
_CLOSING = ("</", "[/", "◁/", "<|end")
_CHANNEL, _MESSAGE = "<|channel|>", "<|message|>"


def strip_thoughts(text: str) -> str:
    """Remove thoughts from a reply; return an empty text if nothing follows them.

    Thoughts stand between marks such as `<think>` and `</think>`. Text before a closing mark without an opening one
    is a thought too, since the opening mark is often part of the prompt. So is all text after an opening mark that
    is never closed. Of a reply in channels, the final one counts.

    Source: the marks are those of the models' chat templates; the channels are OpenAI's harmony format.
    """
    text = _final_channel(text)
    kept: list[str] = []
    start, thinking = 0, False
    for mark in _MARK.finditer(text):
        closing = mark[0].lower().startswith(_CLOSING)
        if closing and not thinking:
            kept.clear()
        elif not closing and not thinking:
            kept.append(text[start : mark.start()])
        start, thinking = mark.end(), not closing
    return "".join(kept) if thinking else "".join((*kept, text[start:]))


def _final_channel(text: str) -> str:
    """Return the content of the last final channel; the text itself if there are no channels."""
    if _CHANNEL not in text:
        return text
    finals = [part for part in text.split(_CHANNEL)[1:] if part.lstrip().startswith("final")]
    if not finals:
        return ""
    head, mark, content = finals[-1].partition(_MESSAGE)
    return (content if mark else head.lstrip().removeprefix("final")).partition("<|")[0]


AnswerT = TypeVar("AnswerT", bound=Answer)
_REPEATED = "answer/repeated"
# An answer repeated this often is assumed not to change.
MOST_REPEATS = 2
_MOST_FIELD_ERRORS = 12
# Of the first question, the second and all later ones: the server's own, then colder, so that less changes at random.
_TEMPERATURES = (None, 0.2, 0.1)
# After an answer that was given again: a small model repeats it at its server's temperature of 0.3 as well, and
# writes nonsense at 0.9.
_AFTER_REPEAT = 0.6


@dataclass(slots=True)
class Log:
    """State of `ask` in a conversation: the record, and (prompt, answer) -> round and findings of a refused answer."""

    conversation: Conversation
    refused: dict[tuple[str, str], tuple[int, tuple[Diagnostic, ...]]] = field(default_factory=dict)

    def refuse(self, prompt: Prompt, answer: Answer, findings: Sequence[Diagnostic]) -> None:
        """Register an answer to a prompt as wrong, so that it is not accepted when it is repeated."""
        number = len(self.conversation.rounds)
        self.refused.setdefault((prompt.sha256, _key(answer)), (number, tuple(findings)))

    def repeated(self, prompt: Prompt, answer: Answer) -> tuple[Diagnostic, ...]:
        """Return the findings about an answer to a prompt that was refused before; empty for a new answer."""
        number, findings = self.refused.get((prompt.sha256, _key(answer)), (0, ()))
        if not number:
            return ()
        again = f"this is the answer of round {number} again, and it is wrong for the same reasons"
        hint = "change what the points below name; an unchanged answer cannot be used"
        return (finding(_REPEATED, again, "reply", hint=hint), *findings)

    def record(
        self, prompt: Prompt, request: ChatRequest, reply: ChatReply, findings: tuple[Diagnostic, ...], accepted: bool
    ) -> None:
        """Append a round to the conversation."""
        self.conversation.add(
            Round(
                module=prompt.module,
                number=len(self.conversation.rounds) + 1,
                request_sha256=reply.request_sha256 or request.digest(),
                prompt_sha256=prompt.sha256,
                reply=reply.text,
                findings=findings,
                accepted=accepted,
                finish_reason=reply.finish_reason,
                input_tokens=reply.input_tokens,
                output_tokens=reply.output_tokens,
                latency_s=reply.latency_s,
                recorded=reply.recorded,
                attempts=reply.attempts,
                template_sha256=request.template,
            )
        )


def ask(
    transport: Transport,
    prompt: Prompt,
    schema: type[AnswerT],
    check: Callable[[AnswerT], Iterable[Diagnostic]],
    *,
    rounds: int,
    log: Log,
    objection: Refused | None = None,
    standing: AnswerT | None = None,
    admitted: Admitted = ANYTHING,
) -> AnswerT:
    """Ask until an answer has the schema's form and `check` finds nothing wrong in it.

    Args:
        transport: Transport to the model; it also keeps the budget, and raises when it is spent.
        prompt: The question.
        schema: The answer's form.
        check: Returns the findings about an answer of that form: errors refuse it, warnings are asked about once.
        rounds: Most questions to the model, at least 1.
        log: Record of every round.
        objection: An earlier answer to this prompt with the findings about it.
        standing: The same answer as it was read: where the objection is about some entries, the others stay.
        admitted: What the answer may name and say, for the schema of the wire.

    Raises:
        AnswersRefused: No answer was valid; the exception has the whole conversation.
        ModelError: The model did not reply, or the budget is spent.
    """
    refused, doubts, before, repeats = objection, set[tuple[str, ...]](), list[str](), 0
    fallback: AnswerT | None = None
    findings: tuple[Diagnostic, ...] = () if objection is None else objection.findings
    for number in range(max(rounds, 1)):
        usual = _TEMPERATURES[min(number + (objection is not None), len(_TEMPERATURES) - 1)]
        again = () if refused is None else refused.entries
        wire = wire_schema(schema, admitted, again)
        request = prompt.request(wire, refused, _AFTER_REPEAT if repeats else usual)
        reply = transport.complete(request)
        answer, findings = _judged(reply, schema, check, standing, again)
        repeated = () if answer is None else log.repeated(prompt, answer)
        if repeated:
            findings = repeated
            repeats += 1
        errors = errors_of(findings)
        news = {finding_key(found) for found in findings} - doubts
        accepted = answer is not None and not errors and not news
        log.record(prompt, request, reply, findings, accepted)
        if answer is not None and not errors:
            fallback = answer
            if accepted:
                return answer
            doubts |= news
        elif answer is not None and not repeated:
            log.refuse(prompt, answer, findings)
        if repeats >= MOST_REPEATS:
            break
        if refused is not None and refused is not objection:
            before.append(summary(refused.findings))
        shown, wrong = reply.text, again
        if answer is not None:
            standing = answer
            shown = answer.shown() if again or answer.resolved() is not answer else reply.text
            wrong = entries_of(found for found in findings if found.code != _REPEATED)
        refused = Refused(shown, findings, tuple(dict.fromkeys(before)), wrong if len(wrong) < admitted.entries else ())
    if fallback is not None:
        return fallback
    raise AnswersRefused(log.conversation, prompt.module, findings, insists=repeats >= MOST_REPEATS)


def _judged(
    reply: ChatReply,
    schema: type[AnswerT],
    check: Callable[[AnswerT], Iterable[Diagnostic]],
    standing: AnswerT | None = None,
    again: Sequence[int] = (),
) -> tuple[AnswerT | None, tuple[Diagnostic, ...]]:
    """Return the answer in a reply, None if it does not have the schema's form, and the findings.

    Entries that were asked for `again` are put into the answer that stands otherwise.
    """
    cut_off = reply.finish_reason == "length"
    found = extract(reply.text, schema.found_in, cut_off=cut_off, fields=tuple(schema.model_fields))
    if isinstance(found, Diagnostic):
        return None, (found,)
    try:
        answer = schema.model_validate(lenient.visible(found))
        answer = standing.with_entries(answer, again) if standing is not None and again else answer
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
    problem = message[:1].lower() + message[1:]
    return finding("answer/field", f"{problem}{given}", place or "reply")


def _quoted(value: object) -> str:
    if isinstance(value, dict | list):
        return f"{'an object' if isinstance(value, dict) else 'a list'} of {len(value)}"
    if isinstance(value, int) and abs(value) >= 10**20:
        return "a huge integer"
    shown = ascii(value)
    return shown if len(shown) <= 60 else f"{shown[:57]}..."


def _key(answer: Answer) -> str:
    return json.dumps(answer.resolved().model_dump(), sort_keys=True)
