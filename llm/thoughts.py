"""What a model says, without what it thought before: thoughts hold drafts, and a draft is no answer.

Servers are asked to keep thoughts apart; many send them within the reply, in one of the forms below.
"""

from __future__ import annotations

import re

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
