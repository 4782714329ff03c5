"""The JSON answer in a model's reply, whatever stands around it: prose, a code fence, thoughts, drafts.

Nothing is executed and nothing is mended: a text that is no JSON is a finding with its place.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable

from llm.answers.conversation import finding
from oag import Diagnostic
from oag.model.jsonfile import STRICT

# Longer than any answer; reading stops there.
LONGEST_REPLY = 400_000
# So many opening brackets are tried before the text counts as one without JSON.
_MOST_STARTS = 2_000
_LONGEST_QUOTED = 60
# Where an object or a list of objects may begin, in JSON or in what is meant for it; a brace in prose does not look so.
# A name that lacks one of its quotes, or has another sign in its place, is meant for a name all the same.
_OPENING = re.compile(
    r"""\{(?=\s*(?:["'\u201c\u201d\u2018\u2019}]|//|/\*|[^\w\s{}\[\]]?[A-Za-z_]\w*[^\w\s{}\[\]:]?\s*:))|\[(?=\s*\{)"""
)
# Reads on past what STRICT refuses, to know where it ends.
_LENIENT = json.JSONDecoder(parse_int=str)
_AnswerIn = Callable[[object], dict[str, object] | None]


def extract(text: str, answer_in: _AnswerIn, *, cut_off: bool = False) -> dict[str, object] | Diagnostic:
    """Returns the last answer in a reply, or the finding that says why there is none.

    A model that writes a draft writes the answer after it; so an object after the answer that cannot be read is a
    finding, and what stands before it is not taken in its place.

    Args:
        text: The reply.
        answer_in: Returns the answer that a JSON object or list is or holds, or None.
        cut_off: True when the model stopped at its limit of tokens.

    Returns:
        The answer; without one, the first object there is, whose fields will be found missing.
    """
    if len(text) > LONGEST_REPLY:
        long = f"the reply has {len(text)} characters; no answer needs more than {LONGEST_REPLY}"
        return finding("answer/too-long", long, "reply", hint="answer with the JSON object alone")
    whole, text = text, spoken(text)
    answer: dict[str, object] | None = None
    other: dict[str, object] | None = None
    broken: Diagnostic | None = None
    end = counted = unclosed = 0
    for _ in range(_MOST_STARTS):
        opening = _OPENING.search(text, end)
        if opening is None:
            break
        start = opening.start()
        unclosed += text.count("{", counted, start) - text.count("}", counted, start)
        counted = start
        found, end, problem = _read(text, start)
        # What stands inside a broken object is no answer.
        taken = answer_in(found) if broken is None or unclosed <= 0 else None
        if taken is not None:
            answer, broken = taken, None
        elif isinstance(found, dict):
            other = found if other is None else other
        elif opening[0] == "[":
            # What is in a list that is no answer is looked at by itself.
            end = opening.end()
        elif broken is None:
            broken, unclosed = problem, 0
    else:
        many = f"the reply has more than {_MOST_STARTS} pieces that look like objects"
        broken = finding("answer/broken-json", many, "reply", hint="answer with the JSON object alone")
    if answer is not None and broken is None:
        return answer
    if cut_off:
        said = "the reply was cut off at the limit of tokens before its JSON object ended"
        return finding("answer/cut-off", said, "reply", hint="answer more briefly, with the JSON object alone")
    return broken or other or _nothing(whole, text)


def _read(text: str, start: int) -> tuple[object, int, Diagnostic | None]:
    """Returns the JSON value that begins at a place, where reading ended, and what is wrong with it."""
    try:
        return *STRICT.raw_decode(text, start), None
    except json.JSONDecodeError as error:
        return None, max(error.pos, start + 1), _broken(text, start, error)
    except RecursionError:
        # Nothing that could be meant is nested so deeply; to look for more in there would take long.
        return None, len(text), _unusable("it is nested too deeply")
    except ValueError as refusal:
        problem = _unusable(str(refusal).partition(":")[0])
    try:
        return None, _LENIENT.raw_decode(text, start)[1], problem
    except json.JSONDecodeError as error:
        return None, max(error.pos, start + 1), problem


def _unusable(said: str) -> Diagnostic:
    return finding("answer/broken-json", f"the JSON cannot be used: {said[:200]}", "reply")


def _broken(text: str, start: int, problem: json.JSONDecodeError) -> Diagnostic:
    """Returns what is wrong with a JSON text, with the piece around the place."""
    line = text.count("\n", start, problem.pos) + 1
    piece = " ".join(text[max(start, problem.pos - 30) : problem.pos + 20].split())
    ended = not text[problem.pos : problem.pos + 1].strip() and not text[problem.pos :].strip()
    said = "it ends before its last brace" if ended else f"{problem.msg} at its line {line}, near {piece!r}"
    return finding("answer/broken-json", f"the JSON object cannot be read: {said}", "reply")


def _nothing(whole: str, text: str) -> Diagnostic:
    start = text.find("{")
    if start >= 0:
        _, _, problem = _read(text, start)
        if problem is not None:
            return problem
    hint = "answer with one JSON object that has the fields named above, and nothing else"
    begins = " ".join(text[: 4 * _LONGEST_QUOTED].split())[:_LONGEST_QUOTED]
    if begins:
        said = f"the reply holds no JSON object; it begins {begins!r}"
    elif whole.strip():
        said = "the reply holds thoughts, and no JSON object after them"
    else:
        said = "the reply is empty: it holds no JSON object"
    return finding("answer/no-json", said, "reply", hint=hint)


# One pass over fixed words: the time grows with the length of the reply, whatever it holds.
_MARK = re.compile(
    r"<(?:/?)(?:[a-z]{1,12}:)?(?:think|thinking|thoughts?|reasoning|reflection|scratchpad|analysis)(?:\s[^<>]{0,80})?>"
    r"|\[/?think\]|◁/?think▷|<\|(?:begin|end)_of_thought\|>|<\|(?:start|end)_thinking\|>",
    re.IGNORECASE,
)
_CLOSING = ("</", "[/", "◁/", "<|end")
_CHANNEL, _MESSAGE = "<|channel|>", "<|message|>"


def spoken(text: str) -> str:
    """Returns a reply without its thoughts; empty where nothing was said after them.

    Thoughts stand between marks such as `<think>` and `</think>`. What comes before a closing mark that was never
    opened is thought too (the opening one is often a part of the prompt), and so is all that follows an opening mark
    that is never closed. Of a reply in channels, the final one counts.

    Source: the marks are those of the models' chat templates; the channels are OpenAI's harmony format.
    """
    text = _final_channel(text)
    said: list[str] = []
    start, thinking = 0, False
    for mark in _MARK.finditer(text):
        closing = mark[0].lower().startswith(_CLOSING)
        if closing and not thinking:
            said.clear()
        elif not closing and not thinking:
            said.append(text[start : mark.start()])
        start, thinking = mark.end(), not closing
    return "".join(said) if thinking else "".join((*said, text[start:]))


def _final_channel(text: str) -> str:
    """Returns what the last final channel says; the text itself where there are no channels."""
    if _CHANNEL not in text:
        return text
    finals = [part for part in text.split(_CHANNEL)[1:] if part.lstrip().startswith("final")]
    if not finals:
        return ""
    head, mark, said = finals[-1].partition(_MESSAGE)
    return (said if mark else head.lstrip().removeprefix("final")).partition("<|")[0]
