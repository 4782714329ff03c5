"""Diagnostics of a text: codes, places, excerpts, hints and replacements.

A code names a kind of mistake; the list of codes is closed. A slip names a usual mistake of language models.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from types import MappingProxyType
from typing import Literal, NamedTuple, TypeAlias, get_args

from bddl.ast import Span
from bddl.errors import Scene2DemoError
from bddl.files import read_table
from bddl.terminal import display_width, escape_control

Code: TypeAlias = Literal[
    "bad-binder", "bad-count", "bad-init", "bad-name", "bad-objects", "bad-predicate", "bad-section",
    "bad-wildcard", "contradictory-init", "counted-wildcard", "described-future", "empty-form", "empty-range",
    "empty-text", "extra-parenthesis", "function-notation", "future-without-real", "goal-holds-at-start",
    "idle-real", "impossible-goal", "markdown-fence", "misplaced-predicate", "missing-parenthesis",
    "missing-section", "mixed-instance", "negative-kinematics", "no-parentheses", "not-a-formula", "not-a-name",
    "other-profile", "reflexive-atom", "repeated-category", "repeated-literal", "repeated-object",
    "repeated-predicate", "repeated-section", "several-formulas", "shadowed-variable", "swapped-roles",
    "text-around", "unbound-variable", "unchecked-goal", "unknown-category", "unknown-domain", "unknown-object",
    "unknown-predicate", "unknown-requirement", "unknown-room", "unknown-section", "unmentioned-object",
    "unsupported-form", "unused-variable", "wrong-arity", "wrong-category", "wrong-kind",
]  # fmt: skip

CODES: tuple[Code, ...] = get_args(Code)

Slip: TypeAlias = Literal[
    "argument-count", "bare-words", "binder-shape", "comma", "define-missing", "ellipsis", "empty-answer",
    "equality", "extra-parenthesis", "foreign-comment", "function-notation", "goal-missing", "goal-section",
    "infix-operator", "init-connective", "invented-object", "invented-predicate", "json-text", "letter-case",
    "markdown-fence", "misspelt-section", "misspelt-word", "missing-parenthesis", "nested-atom", "no-formula",
    "object-variant", "operator-symbol", "opposite-predicate", "pddl-form", "predicate-synonym", "prose-around",
    "quoted-name", "robot-predicate", "several-goals", "stray-question-mark", "swapped-roles", "truth-constant",
    "typographic-character", "unbound-variable",
]  # fmt: skip

_TABLES = read_table("codes.toml")
MEANINGS: Mapping[Code, str] = MappingProxyType(_TABLES["meanings"])
SLIPS: Mapping[Slip, str] = MappingProxyType(_TABLES["slips"])
# The slip of a mistake where the text around it shows no other.
SLIP_OF_CODE: Mapping[Code, Slip] = MappingProxyType(_TABLES["slip_of_code"])

_DOUBLE_BACKTICKS = re.compile(r"(?<!\S)`(\S*`\S*)`(?=[\s.,:;]|\Z)")
# Limit of listed mistakes: nobody reads a longer list, and a hostile text would make it endless.
MOST_LISTED = 100
# A longer line is cut around the place, so that an excerpt stays readable.
_EXCERPT_WIDTH = 100
# A longer piece of text is not repeated in a hint.
_QUOTE_LIMIT = 400
_BREAK = re.compile("\n")
_WORD = re.compile(r"[^\s()]+")
_VARIABLE = re.compile(r"\(\s*(\?[^\s()]+)")


Severity: TypeAlias = Literal["error", "warning", "note"]


class Source:
    """A text with its line breaks, which converts offsets to lines and columns."""

    __slots__ = ("_breaks", "text")

    def __init__(self, text: str) -> None:
        self.text = text
        self._breaks: list[int] | None = None

    @property
    def breaks(self) -> list[int]:
        """The offsets of its line breaks, found when they are first asked for."""
        if self._breaks is None:
            # The place before the text counts as a break, so that the first line is no special case.
            self._breaks = [-1, *(found.start() for found in _BREAK.finditer(self.text))]
        return self._breaks

    def span(self, offset: int, length: int = 0) -> Span:
        """Return the place that begins at an offset."""
        breaks = self.breaks
        line = bisect_left(breaks, offset)
        return Span(line, offset - breaks[line - 1], offset, length)

    def word_spans(self, start: int, end: int) -> tuple[Span, ...]:
        """Return the places of the words between two offsets, none of which is in a comment."""
        return tuple(self.span(word.start(), len(word.group())) for word in _WORD.finditer(self.text, start, end))

    def variable_spans(self, start: int, count: int) -> tuple[Span, ...]:
        """Return the places of the first variables behind an offset that follow a parenthesis."""
        found = islice(_VARIABLE.finditer(self.text, start), count)
        return tuple(self.span(variable.start(1), len(variable.group(1))) for variable in found)

    def offset(self, line: int, column: int) -> int:
        """Return the offset of a column, from 1, in a line, from 1; a line past the end counts as the last."""
        return self.breaks[min(line, len(self.breaks)) - 1] + column


def one_line(text: str) -> str:
    """Return the text without comments, on one line; empty when it is too long to be repeated in a hint."""
    if len(text) > 4 * _QUOTE_LIMIT:
        return ""
    joined = " ".join(" ".join(line.partition(";")[0] for line in text.split("\n")).split())
    joined = joined.replace("( ", "(").replace(" )", ")")
    return joined if len(joined) <= _QUOTE_LIMIT else ""


class Replacement(NamedTuple):
    """What to write in place of a piece of a text.

    Attributes:
        offset: Where the piece begins, from 0.
        length: How many characters it has.
        text: What to write instead.
    """

    offset: int
    length: int
    text: str

    def applied(self, whole: str) -> str:
        """Return the whole text with the piece replaced."""
        return whole[: self.offset] + self.text + whole[self.offset + self.length :]


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One mistake in a text.

    Attributes:
        code: Stable name of the kind of mistake (`MEANINGS` explains each).
        line: Line of the place, from 1.
        column: Column of the place, from 1.
        length: Characters that the place covers; 0 for a place between characters.
        excerpt: The line with carets under the place, for a fixed-width font.
        expected: What would have been legal there; may be empty.
        hint: What to do about it, in words; may be empty.
        severity: "error" says that the text cannot be meant so, "warning" that it hardly is, "note" is information.
        slip: The usual slip of a language model that it is, if it is one (`SLIPS` explains each).
        replacement: What the hint says to write, as data; None where the hint names no text that can be taken as it is.
    """

    code: Code
    message: str
    line: int
    column: int
    length: int
    excerpt: str
    expected: tuple[str, ...] = ()
    hint: str = ""
    severity: Severity = "error"
    slip: Slip | None = None
    replacement: Replacement | None = None

    def __post_init__(self) -> None:
        # Both may repeat text of a file; a frozen instance is set like this while it is made.
        object.__setattr__(self, "message", escape_control(self.message))
        object.__setattr__(self, "hint", escape_control(self.hint))

    @property
    def page(self) -> str:
        """The section of the documentation about its code."""
        return f"docs/codes-bddl.md#{self.code}"

    def to_json(self) -> dict[str, object]:
        """Return all fields as plain data."""
        return {
            "code": self.code,
            "severity": self.severity,
            "line": self.line,
            "column": self.column,
            "length": self.length,
            "message": self.message,
            "excerpt": self.excerpt,
            "expected": list(self.expected),
            "hint": self.hint,
            "slip": self.slip,
            "page": self.page,
        }

    def __str__(self) -> str:
        hint = f"\nhint: {self.hint}" if self.hint else ""
        return f"line {self.line}, column {self.column}: {self.message} [{self.code}]\n{self.excerpt}{hint}"


class BDDLError(Scene2DemoError, ValueError):
    """Raised when a text is not legal BDDL; its message shows every mistake that was found."""

    def __init__(self, diagnostics: Iterable[Diagnostic]) -> None:
        self.diagnostics = tuple(diagnostics)
        super().__init__(self.diagnostics)

    @property
    def first_messages(self) -> str:
        """The first three messages, for an error of one line."""
        return "; ".join(found.message for found in self.diagnostics[:3])

    @property
    def first_hint(self) -> str:
        """The hint of the first message; empty without one."""
        return next((found.hint for found in self.diagnostics), "")

    def __str__(self) -> str:
        shown = "\n".join(str(diagnostic) for diagnostic in self.diagnostics)
        count = len(self.diagnostics)
        return shown if count == 1 else f"{count} mistakes in the BDDL text:\n{shown}"


class Reporter:
    """Collects the diagnostics of one text, the first `MOST_LISTED` mistakes and as many warnings.

    Args:
        text: The text as the caller gave it.
        tolerated: Mistakes that do not keep the text from being read, as codes or as `code:case`; they are warnings.
    """

    def __init__(self, text: str, tolerated: Collection[str] = ()) -> None:
        self.text = text
        self.source = Source(text)
        self._tolerated = tolerated
        self._lines: list[str] | None = None
        self._only: frozenset[Code] | None = None
        self._found: list[tuple[int, int, Diagnostic]] = []
        self._counts: dict[Severity, int] = {}
        # Mistakes whose hint can only be the whole corrected text, which `bddl.repair` finds.
        self.whole_text_mistakes: set[Diagnostic] = set()

    def add(
        self,
        code: Code,
        span: Span,
        message: str,
        *,
        expected: Iterable[str] = (),
        hint: str = "",
        related: Span | None = None,
        severity: Severity = "error",
        case: str = "",
        replacement: Replacement | None = None,
        whole: bool = False,
    ) -> bool:
        """Record a mistake at a place.

        Args:
            expected: What would have been legal there.
            related: Another place that belongs to it; it is marked with `-` in the excerpt.
            severity: What it is where it is not tolerated.
            case: A narrower name of the mistake, when some mistakes of this kind are tolerated and others are not.
            replacement: What the hint says to write, as data.
            whole: The mistake is one of the text as a whole.

        Returns:
            True when reading may go on as if the place were legal: the mistake is tolerated.
        """
        if self.tolerates(code, case):
            severity = "warning"
        tolerated = severity == "warning"
        if self._only is not None and code not in self._only:
            return tolerated
        self._counts[severity] = self._counts.get(severity, 0) + 1
        if self._counts[severity] > MOST_LISTED:
            return tolerated
        if self._counts[severity] == MOST_LISTED:
            message += f" It is number {MOST_LISTED}; those after it are not listed."
        if self._lines is None:
            self._lines = self.text.split("\n")
        excerpt = excerpt_of(self._lines, span, related)
        # A word that has backticks of its own gets other quotation marks.
        message = _DOUBLE_BACKTICKS.sub(r'"\1"', message) if "``" in message else message
        line, column, _, length = span
        expected = tuple(expected)
        diagnostic = Diagnostic(
            code, message, line, column, length, excerpt, expected, hint, severity, replacement=replacement
        )
        self._found.append((span.offset, len(self._found), diagnostic))
        if whole:
            self.whole_text_mistakes.add(diagnostic)
        return tolerated

    def tolerates(self, code: Code, case: str = "") -> bool:
        """Decide whether a mistake does not keep a text from being read."""
        return code in self._tolerated or f"{code}:{case}" in self._tolerated

    def restrict(self, codes: Iterable[Code]) -> None:
        """Record only these codes from here on: after a repair, other findings may be echoes of the first mistake."""
        self._only = frozenset(codes)

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """Everything recorded, in the order of the places."""
        return tuple(diagnostic for _, _, diagnostic in sorted(self._found, key=lambda entry: entry[:2]))

    def __bool__(self) -> bool:
        """True when a mistake keeps the text from being read; warnings do not."""
        return any(diagnostic.severity == "error" for _, _, diagnostic in self._found)

    def place(self, offset: int, length: int = 0) -> Span:
        """Return the span that begins at an offset of the text."""
        return self.source.span(offset, length)

    def replacement_for(self, span: Span, text: str) -> Replacement | None:
        """Return the replacement of a piece of the text; None when there is nothing to write."""
        return Replacement(span.offset, span.length, text) if text else None

    def quote(self, span: Span) -> str:
        """Return the text of a span on one line, for a hint."""
        return one_line(self.text[span.offset : span.offset + span.length])


def excerpt_of(lines: Sequence[str], span: Span, related: Span | None = None) -> str:
    """Return the line of a span with carets under it; a related place is marked with `-`."""
    width = len(str(span.line))
    shown = ""
    if related is not None and related.line != span.line:
        shown = _marked_line(lines, related._replace(length=1), None, width, "-") + "\n"
        related = None
    return shown + _marked_line(lines, span, related, width, "^")


def _below(character: str, mark: str | None) -> str:
    # A tab is kept under a tab, so that the marks stay aligned however wide it is drawn.
    if mark is None and character == "\t":
        return character
    return (mark or " ") * (display_width(character) if character else 1)


def _marked_line(lines: Sequence[str], span: Span, related: Span | None, width: int, mark: str) -> str:
    line = lines[span.line - 1].rstrip("\r") if span.line <= len(lines) else ""
    start = span.column - 1
    end = max(start + 1, min(start + span.length, len(line)))
    first = 0 if len(line) <= _EXCERPT_WIDTH else max(0, min(start - _EXCERPT_WIDTH // 2, len(line) - _EXCERPT_WIDTH))
    last = first + _EXCERPT_WIDTH
    marks = {position: mark for position in range(start, min(end, max(last, start + 1)))}
    if related is not None and related.column - 1 >= first:
        marks.setdefault(related.column - 1, "-")
    shown = escape_control(line[first:last])
    below = "".join(
        _below(shown[place : place + 1], marks.get(first + place)) for place in range(max(marks) + 1 - first)
    )
    if mark not in below:
        below += mark  # Only characters without width are marked.
    before, after = ("..." if first else ""), ("..." if last < len(line) else "")
    return f"{span.line:>{width}} | {before}{shown}{after}\n{'':>{width}} | {' ' * len(before)}{below}"
