"""Prompts: files with places to fill in, and the fence between instructions and data.

Names, categories and queries were written by others. They stand between `<<<label` and `label>>>`, which the data
itself cannot contain, and the instructions say that nothing in there is an instruction.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from string import Template

from llm.wire.transport import ChatRequest, Image, Message
from oag import Diagnostic

# A model's own answer is shown to it again up to this length.
_LONGEST_SHOWN = 12_000
_MOST_FINDINGS = 12


@dataclass(frozen=True, slots=True)
class Prompt:
    """What a module asks before any answer is there.

    Attributes:
        module: 1 to 5, or `llm.answers.conversation.INSPECTOR`, `SUPERVISOR`, or `SPOTTER`.
        system: Instructions that stand above the conversation.
        text: The module's question with its data.
        images: Pictures that go with it.
    """

    module: int
    system: str
    text: str
    images: tuple[Image, ...] = ()

    @property
    def sha256(self) -> str:
        """The SHA-256 of everything that is asked, pictures included."""
        parts = (self.system, self.text, *(image.sha256 for image in self.images))
        return hashlib.sha256("\x00".join(parts).encode("utf-8", "backslashreplace")).hexdigest()

    def request(self, schema: Mapping[str, object], refused: Refused | None = None) -> ChatRequest:
        """Returns the request that asks this, again with what was wrong if an answer was refused."""
        messages = [Message((self.text, *self.images))]
        if refused is not None:
            messages += [Message((_shown(refused.reply),), "assistant"), Message((refused.text(),))]
        return ChatRequest(self.system, tuple(messages), schema)


@dataclass(frozen=True, slots=True)
class Refused:
    """An answer that goes back to the model.

    Attributes:
        reply: The answer as the model wrote it.
        findings: What is wrong with it.
        before: What was wrong with still earlier answers, a line each.
    """

    reply: str
    findings: tuple[Diagnostic, ...]
    before: tuple[str, ...] = ()

    def text(self) -> str:
        """Returns what the model is told: the numbered findings, and what failed earlier."""
        shown = self.findings[:_MOST_FINDINGS]
        listed = [_numbered(number, found) for number, found in enumerate(shown, start=1)]
        if len(self.findings) > len(shown):
            listed.append(f"... and {len(self.findings) - len(shown)} more of this kind.")
        before = "Earlier answers were refused for:\n" + "\n".join(self.before) + "\n" if self.before else ""
        closing = "Mend every point. Where a fix is listed, it was checked and works; you may also find another way."
        if all(found.severity != "error" for found in self.findings):
            closing = "If your answer is what the query means, give the same answer again; otherwise mend it."
        findings = fenced("findings", "\n\n".join(listed))
        return render("answers/feedback", findings=findings, before=before, closing=closing)


def render(name: str, **values: str) -> str:
    """Returns a prompt file with its places filled in.

    Args:
        name: The room of `llm` that has the file among its prompts, and the file, such as "modules/module_3".
        values: Text for each `$place`; what stands in the texts is not looked at again.

    Raises:
        KeyError: A place of the file has no text.
    """
    return _template(name).substitute(values).strip() + "\n"


@cache
def _template(name: str) -> Template:
    room, _, file = name.partition("/")
    return Template((resources.files("llm") / room / "prompts" / f"{file}.md").read_text(encoding="utf-8"))


def fenced(label: str, text: str) -> str:
    """Returns data between marks that it cannot contain itself."""
    inside = re.sub(r">(?=>)", "> ", re.sub(r"<(?=<)", "< ", text))
    return f"<<<{label}\n{inside}\n{label}>>>"


def summary(findings: Sequence[Diagnostic]) -> str:
    """Returns what was wrong with an answer in one line."""
    return "- " + "; ".join(dict.fromkeys(f"{found.code} {found.place}".strip() for found in findings[:_MOST_FINDINGS]))


def _numbered(number: int, found: Diagnostic) -> str:
    first, *rest = str(found).splitlines()
    return "\n".join((f"{number}. {first}", *(f"   {line}" for line in rest)))


def _shown(reply: str) -> str:
    """Returns an earlier reply as the model is shown it again; servers reject an empty one, and half a character."""
    whole = reply.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "replace")
    text = whole.strip() or "(an empty reply)"
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]} ... (cut here)"
