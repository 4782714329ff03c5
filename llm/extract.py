"""The JSON object in a model's reply, whatever stands around it: prose, a code fence, the thoughts before it.

Nothing is executed and nothing is mended: a text that is no JSON is a finding with its place.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping

from llm.findings import finding
from oag import Diagnostic
from oag.jsonfile import STRICT

# Longer than any answer; reading stops there.
LONGEST_REPLY = 400_000
# So many opening braces are tried before the text counts as one without JSON.
_MOST_STARTS = 200
_THOUGHTS = re.compile(r"<think(?:ing)?>.*?</think(?:ing)?>", re.DOTALL | re.IGNORECASE)
_Recognise = Callable[[Mapping[str, object]], bool]


def extract(text: str, recognises: _Recognise, *, cut_off: bool = False) -> dict[str, object] | Diagnostic:
    """Returns the first object in a reply that looks like an answer, or the finding that says why there is none.

    Args:
        text: The reply.
        recognises: Decides whether an object looks like the answer that was asked for.
        cut_off: True when the model stopped at its limit of tokens.

    Returns:
        The object; without one that is recognised, the first one there is, whose fields will be found missing.
    """
    if len(text) > LONGEST_REPLY:
        problem = f"the reply has {len(text)} characters; no answer needs more than {LONGEST_REPLY}"
        return finding("answer/too-long", problem, "reply", hint="answer with the JSON object alone")
    text = _THOUGHTS.sub("", text)
    other: dict[str, object] | None = None
    broken: Diagnostic | None = None
    start = text.find("{")
    for _ in range(_MOST_STARTS):
        if start < 0:
            break
        try:
            found, end = STRICT.raw_decode(text, start)
        except json.JSONDecodeError as error:
            end = max(error.pos, start + 1)
            broken = broken or _broken(text, start, error)
        except (RecursionError, ValueError) as refusal:  # a ValueError too: an integer of thousands of digits
            said = "it is nested too deeply" if isinstance(refusal, RecursionError) else str(refusal).partition(":")[0]
            broken = broken or finding("answer/broken-json", f"the JSON cannot be used: {said[:200]}", "reply")
            end = start + 1
        else:
            if recognises(found):
                return found
            other = found if other is None else other
        start = text.find("{", end)
    if cut_off:
        problem = "the reply was cut off at the limit of tokens before its JSON object ended"
        return finding("answer/cut-off", problem, "reply", hint="answer more briefly, with the JSON object alone")
    # What stands inside a broken object is no answer.
    if broken is not None or other is None:
        hint = "answer with one JSON object that has the fields named above, and nothing else"
        return broken or finding("answer/no-json", "the reply holds no JSON object", "reply", hint=hint)
    return other


def _broken(text: str, start: int, problem: json.JSONDecodeError) -> Diagnostic:
    """Returns what is wrong with a JSON text, with the piece around the place."""
    line = text.count("\n", start, problem.pos) + 1
    piece = " ".join(text[max(start, problem.pos - 30) : problem.pos + 20].split())
    ended = problem.pos >= len(text.rstrip())
    said = "it ends before its last brace" if ended else f"{problem.msg} at its line {line}, near {piece!r}"
    return finding("answer/broken-json", f"the JSON object cannot be read: {said}", "reply")
