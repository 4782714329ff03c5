"""Print trees as text, and lay out texts.

Parsing what `format` prints gives an equal tree. `lay_out` keeps every word and comment as it was written; only the
blanks between them change.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from bddl.ast import And, Binder, Formula, FormulaNode, formula_text
from bddl.dialects import DOMAINS, SYNSET
from bddl.lexer import hide_free_text
from bddl.problem import ROOT_CATEGORY, Domain, LiberoProblem, Problem, Region, SceneStyle, TypedObject

INDENT = "    "


def format(node: Problem | Domain | Formula) -> str:
    """Return BDDL text: a formula on one line, a problem or a domain as an indented file that ends in a newline.

    The question marks of a goal's objects stay as BEHAVIOR's files have them; problems of its domains that were built
    by hand get them.

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
    return formula_text(node, marked=None)


def _problem_text(problem: Problem) -> str:
    objects = _typed_lines(problem.objects)
    # BEHAVIOR marks the objects of a goal as well; of what was read, those that the text marks.
    behavior = problem.domain in DOMAINS and all(SYNSET.fullmatch(item.category) for item in problem.objects)
    marked = True if behavior and problem.objects else None
    goal = (
        ["(and", *(f"{INDENT}{formula_text(part, marked)}" for part in problem.goal.parts), ")"]
        if isinstance(problem.goal, And) and problem.goal.parts
        else [formula_text(problem.goal, marked)]
    )
    lines = [
        f"(define (problem {problem.name})",
        f"{INDENT}(:domain {problem.domain})",
        *(_libero_lines(problem) if isinstance(problem, LiberoProblem) else []),
        *_section_lines(":objects", objects),
        *_section_lines(":init", [formula_text(literal) for literal in problem.init]),
        *_section_lines(":goal", goal),
        ")",
    ]
    return "\n".join(lines) + "\n"


def _libero_lines(problem: LiberoProblem) -> list[str]:
    regions = [line for region in problem.regions for line in _region_lines(region)]
    styles = [_style_line(style) for style in problem.styles]
    return [
        f"{INDENT}(:language {problem.language})",
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
        *([f"{INDENT}(:requirements {' '.join(domain.requirements)})"] if domain.requirements else []),
        *(_section_lines(":types", _typed_lines(domain.types)) if domain.types else []),
        *_section_lines(":predicates", predicates),
        *(f"{INDENT}{action.text}" for action in domain.actions),
        ")",
    ]
    return "\n".join(lines) + "\n"


def _typed_lines(items: Sequence[TypedObject]) -> list[str]:
    return [
        f"{' '.join(item.name for item in group)} - {category}"
        for category, group in groupby(items, key=lambda item: item.category)
    ]


def _typed_words(parameters: Sequence[Binder]) -> list[str]:
    typed = any(parameter.category != ROOT_CATEGORY for parameter in parameters)
    return [
        f"?{parameter.variable} - {parameter.category}" if typed else f"?{parameter.variable}"
        for parameter in parameters
    ]


def _section_lines(head: str, content: list[str]) -> list[str]:
    if not content:
        return [f"{INDENT}({head})"]
    return [f"{INDENT}({head}", *(f"{INDENT * 2}{line}" for line in content), f"{INDENT})"]


def _region_lines(region: Region) -> list[str]:
    lines = [f"({region.name}", f"    (:target {region.target})"]
    if region.ranges:
        rows = [(each.x_min_m, each.y_min_m, each.x_max_m, each.y_max_m) for each in region.ranges]
        lines.append(f"    (:ranges ({' '.join(map(_row, rows))}))")
    if region.yaw_rad is not None:
        lines.append(f"    (:yaw_rotation ({_row(region.yaw_rad)}))")
    if region.rgba is not None:
        lines.append(f"    (:rgba {_row(region.rgba)})")
    return [*lines, ")"]


def _style_line(style: SceneStyle) -> str:
    values = {":floor": style.floor, ":wall": style.wall}
    parts = [f"({word} {value})" for word, value in values.items() if value is not None]
    return f"({' '.join([style.name, *parts])})"


def _row(numbers: Iterable[float]) -> str:
    # repr gives back the same number when it is read.
    return f"({' '.join(map(repr, numbers))})"


WIDTH = 100
# Deeper forms are not indented further; a file of thousands of levels would be nothing but blanks.
MOST_LEVELS = 40
_TOKEN = re.compile(r"(?P<comment>;[^\n]*)|(?P<bracket>[()])|(?P<word>[^\s();\ufeff]+)|(?P<blank>[\s\ufeff]+)")
# Sections that are lists: each item goes on a line of its own, however short the section is.
_LISTS = frozenset({":objects", ":init", ":goal", ":regions", ":fixtures", ":ranges"})
# How many forms stay on the first line of a broken one: the numbers and variables of quantifiers.
_BINDERS = {"forall": 1, "exists": 1, "forn": 2, "forpairs": 2, "fornpairs": 3}


@dataclass(slots=True, eq=False)
class _Piece:
    """A word, a comment, or a form with the pieces inside it.

    Attributes:
        text: The word, the comment, or the form on one line; None for a form that is too long for that.
        trailing: True for a comment on the same line as what precedes it.
        spaced: True when an empty line precedes it.
        prose: True for the content of a section of prose, and for that section, which is never broken.
        parts: The content of a form, or None for a word or a comment.
    """

    text: str | None
    trailing: bool = False
    spaced: bool = False
    prose: bool = False
    parts: list[_Piece] | None = None

    @property
    def is_comment(self) -> bool:
        return self.text is not None and self.text.startswith(";")

    @property
    def head(self) -> str:
        """The first word of a form."""
        return (self.parts[0].text or "").lower() if self.parts else ""


def lay_out(text: str, free_text: Collection[str] = ()) -> str:
    """Return the text with uniform line breaks and indentation; raise ValueError when its parentheses do not match.

    Forms that fit stay on one line; of a longer one every part goes on a line of its own. Objects go by category,
    literals one a line. The words and comments stay, and so does the text of the sections that are prose (`free_text`);
    of empty lines, several become one. Laying the result out again changes nothing.

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
    return "\n".join(line.rstrip() for line in _lines(root)) + "\n"


def comments(text: str, free_text: Collection[str] = ()) -> list[str]:
    """Return the comments of a text, in order."""
    found = _TOKEN.finditer(hide_free_text(text, free_text))
    return [text[token.start() : token.end()].rstrip() for token in found if token.lastgroup == "comment"]


def _read(text: str, masked: str, free_text: Collection[str]) -> _Piece:
    root = _Piece(None, parts=[])
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
            parts.append(_Piece(word.rstrip(), trailing="\n" not in blank, spaced=spaced))
        elif word == "(":
            form = _Piece(None, parts=[], spaced=spaced)
            parts.append(form)
            stack.append(form)
        elif word == ")":
            if len(stack) == 1:
                raise ValueError("A closing parenthesis closes nothing.")
            stack.pop()
        elif len(stack) > 1 and stack[-1].head in free_text:
            # The blanks before a word of prose stay as they are.
            prose = f"{parts.pop().text}{blank}{word}" if parts and parts[-1].prose else word
            parts.append(_Piece(prose, prose=True))
        else:
            parts.append(_Piece(word, spaced=spaced))
        blank = ""
    if len(stack) > 1:
        raise ValueError("A parenthesis is never closed.")
    return root


def _measure(root: _Piece) -> None:
    """Write every form that fits on one line, inner ones first."""
    forms = [root]
    for form in forms:
        forms.extend(part for part in form.parts or () if part.parts is not None)
    for form in reversed(forms):
        parts = form.parts or []
        texts = [part.text for part in parts if part.text is not None and not part.is_comment]
        whole = len(texts) == len(parts)
        form.prose = whole and any(part.prose for part in parts if part.parts is None)
        listed = form.head == "define" or (form.head in _LISTS and len(parts) > 1)
        line = f"({' '.join(texts)})"
        form.text = line if form.prose or (whole and not listed and len(line) <= WIDTH) else None


def _lines(root: _Piece) -> list[str]:
    """Return the lines of a text; each part of the root begins one of its own."""
    lines: list[str] = []
    # Pieces still to be written, with their levels; a string closes a form.
    pending: list[tuple[_Piece | str, int]] = [(part, 0) for part in reversed(root.parts or [])]
    while pending:
        piece, level = pending.pop()
        indent = INDENT * min(level, MOST_LEVELS)
        if isinstance(piece, str):
            lines.append(indent + piece)
            continue
        if piece.is_comment and piece.trailing and lines:
            lines[-1] += f" {piece.text}"
            continue
        if piece.spaced:
            lines.append("")
        fits = piece.parts is None or piece.prose
        if piece.text is not None and (fits or len(indent) + len(piece.text) <= WIDTH):
            lines.append(indent + piece.text)
        else:
            opening, rest = _opening(piece)
            lines.append(f"{indent}({opening}")
            pending.append((")", level))
            pending.extend((part, level + 1) for part in reversed(rest))
    return lines


def _opening(form: _Piece) -> tuple[str, list[_Piece]]:
    parts, head = form.parts or [], form.head
    kept: list[str] = []
    binders = _BINDERS.get(head, 0)
    for part in parts:
        is_form = part.parts is not None
        short = is_form and part.text is not None and len(part.text) <= WIDTH // 2
        is_name = short and head == "define" and len(kept) == 1 and part.head == "problem"
        is_binder = short and binders > 0
        is_word = not is_form and not part.is_comment and (not kept or head not in _LISTS)
        if part.text is None or not (is_word or is_binder or is_name):
            break
        binders -= is_binder
        kept.append(part.text)
    rest = parts[len(kept) :]
    return " ".join(kept), list(_by_category(rest)) if head in (":objects", ":fixtures") else rest


def _by_category(parts: list[_Piece]) -> Iterator[_Piece]:
    line: list[_Piece] = []
    for position, part in enumerate(parts):
        alone = part.is_comment or part.parts is not None
        if not alone:
            line.append(part)
        if line and (alone or (position and parts[position - 1].text == "-")):
            yield _joined(line)
            line = []
        if alone:
            yield part
    if line:
        yield _joined(line)


def _joined(words: list[_Piece]) -> _Piece:
    return _Piece(" ".join(word.text or "" for word in words), spaced=words[0].spaced)
