"""From the syntax tree to text, and texts laid out anew.

Parsing what `format` prints gives back an equal tree. `lay_out` keeps every word and comment as it was written; only
the blanks between them change.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby

from bddl.reading.words import hide_free_text
from bddl.syntax.libero import LiberoProblem, Region, SceneStyle
from bddl.syntax.problem import ROOT_CATEGORY, Domain, Problem, TypedObject
from bddl.syntax.tree import And, Binder, Formula, FormulaNode, formula_text

_INDENT = "    "


def format(node: Problem | Domain | Formula) -> str:
    """Returns BDDL text: a formula on one line, a problem or a domain as an indented file that ends in a newline.

    Args:
        node: A formula, a problem or a domain.

    Returns:
        Text for which `parse_formula`, `parse` or `parse_domain` returns an equal tree, by the same profile.

    Raises:
        TypeError: It is none of these.

    Example:
        >>> import bddl
        >>> bddl.format(bddl.Not(bddl.Atom("open", ("refrigerator_0",))))
        '(not (open refrigerator_0))'
    """
    if isinstance(node, Problem):
        return _problem_text(node)
    if isinstance(node, Domain):
        return _domain_text(node)
    if not isinstance(node, FormulaNode):
        raise TypeError(f"A formula, a problem or a domain was expected, not {node!r}.")
    return formula_text(node)


def _problem_text(problem: Problem) -> str:
    objects = _typed_lines(problem.objects)
    goal = (
        ["(and", *(f"{_INDENT}{formula_text(part)}" for part in problem.goal.parts), ")"]
        if isinstance(problem.goal, And) and problem.goal.parts
        else [formula_text(problem.goal)]
    )
    lines = [
        f"(define (problem {problem.name})",
        f"{_INDENT}(:domain {problem.domain})",
        *(_libero_lines(problem) if isinstance(problem, LiberoProblem) else []),
        *_section_lines(":objects", objects),
        *_section_lines(":init", [formula_text(literal) for literal in problem.init]),
        *_section_lines(":goal", goal),
        ")",
    ]
    return "\n".join(lines) + "\n"


def _libero_lines(problem: LiberoProblem) -> list[str]:
    """Returns the lines of the sections that only LIBERO has; formulas may speak of what they name."""
    regions = [line for region in problem.regions for line in region_lines(region)]
    styles = [style_line(style) for style in problem.styles]
    return [
        f"{_INDENT}{language_line(problem)}",
        *_section_lines(":regions", regions),
        *_section_lines(":fixtures", _typed_lines(problem.fixtures)),
        *_section_lines(":obj_of_interest", list(problem.objects_of_interest)),
        *(_section_lines(":scene_properties", styles) if styles else []),
    ]


def _domain_text(domain: Domain) -> str:
    predicates = [
        f"({' '.join([predicate.name, *_typed_words(predicate.parameters)])})" for predicate in domain.predicates
    ]
    lines = [
        f"(define (domain {domain.name})",
        *([f"{_INDENT}(:requirements {' '.join(domain.requirements)})"] if domain.requirements else []),
        *(_section_lines(":types", _typed_lines(domain.types)) if domain.types else []),
        *_section_lines(":predicates", predicates),
        *(f"{_INDENT}{action.text}" for action in domain.actions),
        ")",
    ]
    return "\n".join(lines) + "\n"


def _typed_lines(items: Sequence[TypedObject]) -> list[str]:
    return [
        f"{' '.join(item.name for item in group)} - {category}"
        for category, group in groupby(items, key=lambda item: item.category)
    ]


def _typed_words(parameters: Sequence[Binder]) -> list[str]:
    """Returns the parameters of a predicate, their types left out where all of them are `object`."""
    typed = any(parameter.category != ROOT_CATEGORY for parameter in parameters)
    return [
        f"?{parameter.variable} - {parameter.category}" if typed else f"?{parameter.variable}"
        for parameter in parameters
    ]


def _section_lines(head: str, content: list[str]) -> list[str]:
    """Returns the lines of one section, indented inside `define`; an empty one stays on one line."""
    if not content:
        return [f"{_INDENT}({head})"]
    return [f"{_INDENT}({head}", *(f"{_INDENT * 2}{line}" for line in content), f"{_INDENT})"]


def region_lines(region: Region) -> list[str]:
    """Returns the lines of one region, each attribute on a line of its own."""
    lines = [f"({region.name}", f"    (:target {region.target})"]
    if region.ranges:
        rows = [(each.x_min_m, each.y_min_m, each.x_max_m, each.y_max_m) for each in region.ranges]
        lines.append(f"    (:ranges ({' '.join(map(_row, rows))}))")
    if region.yaw_rad is not None:
        lines.append(f"    (:yaw_rotation ({_row(region.yaw_rad)}))")
    if region.rgba is not None:
        lines.append(f"    (:rgba {_row(region.rgba)})")
    return [*lines, ")"]


def style_line(style: SceneStyle) -> str:
    """Returns the line of one part of the scene."""
    said = {":floor": style.floor, ":wall": style.wall}
    parts = [f"({word} {value})" for word, value in said.items() if value is not None]
    return f"({' '.join([style.name, *parts])})"


def language_line(problem: LiberoProblem) -> str:
    """Returns the section with the instruction, as the file had it."""
    return f"(:language {problem.language})"


def _row(numbers: Iterable[float]) -> str:
    # repr gives back the same number when it is read.
    return f"({' '.join(map(repr, numbers))})"


INDENT = "    "
WIDTH = 100
# Deeper forms are not indented further; a file of thousands of levels would be nothing but blanks.
MOST_LEVELS = 40
_TOKEN = re.compile(r"(?P<comment>;[^\n]*)|(?P<bracket>[()])|(?P<word>[^\s();\ufeff]+)|(?P<blank>[\s\ufeff]+)")
# Sections that list things: each goes on a line of its own, however short the section is.
_LISTS = frozenset({":objects", ":init", ":goal", ":regions", ":fixtures", ":ranges"})
_QUANTIFIERS = frozenset({"forall", "exists", "forn", "forpairs", "fornpairs"})


@dataclass(slots=True, eq=False)
class _Piece:
    """A word, a comment, or a form with the pieces inside it.

    Attributes:
        text: The word or the comment; empty for a form.
        beside: True for a comment that stands on the line of what precedes it.
        spaced: True when an empty line precedes it.
        raw: True for a section of prose, which is never broken.
        parts: What a form holds, or None for a word or a comment.
        width: How long a form is on one line; too long to fit when there is a comment in it.
    """

    text: str = ""
    beside: bool = False
    spaced: bool = False
    raw: bool = False
    parts: list[_Piece] | None = None
    width: int = 0

    @property
    def is_comment(self) -> bool:
        """True for a comment."""
        return self.text.startswith(";")

    @property
    def head(self) -> str:
        """The first word of a form."""
        return self.parts[0].text.lower() if self.parts else ""


def lay_out(text: str, free_text: Collection[str] = ()) -> str:
    """Returns the text with its lines broken and indented in one way, whoever wrote it.

    Forms that fit stay on one line; of a longer one every part goes on a line of its own. Objects go by category,
    literals one a line. Comments stay beside what they stand beside; single empty lines stay, several become one.

    Args:
        text: BDDL text whose parentheses match, such as any that `parse` reads.
        free_text: Names of sections whose content is prose; it stays as it is.

    Returns:
        The text with the same words and the same comments in the same order, ending in a newline. Laying that out
        again changes nothing.

    Raises:
        ValueError: The parentheses do not match.

    Example:
        >>> print(lay_out("(define (problem p) (:domain d) (:goal (open a))) ; done"), end="")
        (define (problem p)
            (:domain d)
            (:goal
                (open a)
            )
        ) ; done
    """
    root = _read(text, hide_free_text(text, free_text), free_text)
    _measure(root)
    writer = _Writer()
    writer.write(root)
    return "\n".join(line.rstrip() for line in writer.lines) + "\n"


def comments(text: str, free_text: Collection[str] = ()) -> list[str]:
    """Returns the comments of a text, in order."""
    found = _TOKEN.finditer(hide_free_text(text, free_text))
    return [text[token.start() : token.end()].rstrip() for token in found if token.lastgroup == "comment"]


def _read(text: str, masked: str, free_text: Collection[str]) -> _Piece:
    """Returns the pieces of a text as the parts of one nameless form."""
    root = _Piece(parts=[])
    stack = [root]
    blank = "\n"
    for token in _TOKEN.finditer(masked):
        kind, word = token.lastgroup, text[token.start() : token.end()]
        if kind == "blank":
            blank = word
            continue
        parts = stack[-1].parts
        if parts is None:
            raise ValueError("A word cannot hold forms.")
        spaced = blank.count("\n") > 1 and bool(parts)
        if kind == "comment":
            parts.append(_Piece(word.rstrip(), beside="\n" not in blank, spaced=spaced))
        elif word == "(":
            form = _Piece(parts=[], spaced=spaced)
            parts.append(form)
            stack.append(form)
        elif word == ")":
            if len(stack) == 1:
                raise ValueError("A closing parenthesis closes nothing.")
            stack.pop()
        elif parts and parts[0].text.lower() in free_text and len(stack) > 1:
            _extend(parts, blank, word)
        else:
            parts.append(_Piece(word, spaced=spaced))
        blank = ""
    if len(stack) > 1:
        raise ValueError("A parenthesis is never closed.")
    return root


def _extend(parts: list[_Piece], blank: str, word: str) -> None:
    """Adds a word of prose, with the blanks before it as they are."""
    if len(parts) == 1:
        parts.append(_Piece(word, raw=True))
    else:
        parts[-1].text += blank + word


def _measure(root: _Piece) -> None:
    """Sets the width of every form, inner ones first."""
    forms = [root]
    for form in forms:
        forms.extend(part for part in form.parts or () if part.parts is not None)
    for form in reversed(forms):
        parts = form.parts or []
        if any(part.raw for part in parts):
            continue
        broken = any(part.is_comment for part in parts) or form.head == "define"
        broken = broken or (form.head in _LISTS and len(parts) > 1)
        widths = [len(part.text) if part.parts is None else part.width for part in parts]
        flat = sum(widths) + max(0, len(parts) - 1) + len("()")
        form.width = WIDTH + 1 if broken else min(WIDTH + 1, flat)


@dataclass(slots=True)
class _Writer:
    """Lines under construction; what is still to be written lies on a stack."""

    lines: list[str] = field(default_factory=list)

    def write(self, root: _Piece) -> None:
        """Writes the parts of the root, each on a line of its own."""
        pending: list[tuple[_Piece | str, int]] = [(part, 0) for part in reversed(root.parts or [])]
        while pending:
            piece, level = pending.pop()
            indent = INDENT * min(level, MOST_LEVELS)
            if isinstance(piece, str):
                self.lines.append(indent + piece)
            elif piece.is_comment and piece.beside and self.lines:
                self.lines[-1] += f" {piece.text}"
            elif piece.parts is None or len(indent) + piece.width <= WIDTH:
                self._begin(piece, indent + _flat(piece))
            else:
                opening, rest = _opening(piece)
                self._begin(piece, f"{indent}({opening}")
                pending.append((")", level))
                pending.extend((part, level + 1) for part in reversed(rest))

    def _begin(self, piece: _Piece, line: str) -> None:
        if piece.spaced:
            self.lines.append("")
        self.lines.append(line)


def _opening(form: _Piece) -> tuple[str, list[_Piece]]:
    """Returns what stays on the first line of a broken form, and the parts that go below."""
    parts = form.parts or []
    kept = 0
    binders = 0 if form.head not in _QUANTIFIERS else 2 if form.head == "fornpairs" else 1
    binders += form.head in ("forn", "forpairs")
    binders += form.head == "fornpairs"
    for part in parts:
        word = part.parts is None and not part.is_comment
        is_name = form.head == "define" and kept == 1 and part.head == "problem" and part.width <= WIDTH // 2
        is_binder = part.parts is not None and binders > 0 and part.width <= WIDTH // 2
        if not (word and (kept == 0 or form.head not in _LISTS)) and not is_binder and not is_name:
            break
        binders -= is_binder
        kept += 1
    rest = parts[kept:]
    if form.head in (":objects", ":fixtures"):
        rest = list(_by_category(rest))
    return " ".join(map(_flat, parts[:kept])), rest


def _by_category(parts: list[_Piece]) -> Iterator[_Piece]:
    """Yields the lines of a list of objects: names up to their category, and comments."""
    line: list[_Piece] = []
    for position, part in enumerate(parts):
        if part.is_comment or part.parts is not None:
            if line:
                yield _joined(line)
            line = []
            yield part
            continue
        line.append(part)
        if position and parts[position - 1].text == "-":
            yield _joined(line)
            line = []
    if line:
        yield _joined(line)


def _joined(words: list[_Piece]) -> _Piece:
    return _Piece(" ".join(word.text for word in words), spaced=words[0].spaced)


def _flat(piece: _Piece) -> str:
    texts: list[str] = []
    pending: list[_Piece | str] = [piece]
    after_opening = True
    while pending:
        item = pending.pop()
        if isinstance(item, str):
            texts.append(item)
            after_opening = False
            continue
        if not after_opening:
            texts.append(" ")
        after_opening = False
        if item.parts is None:
            texts.append(item.text)
        else:
            texts.append("(")
            after_opening = True
            pending.append(")")
            pending.extend(reversed(item.parts))
    return "".join(texts)
