"""From the syntax tree to text. Parsing what is printed gives back an equal tree."""

from __future__ import annotations

from itertools import groupby

from bddl.problem import Problem
from bddl.syntax import And, Formula, formula_text

_INDENT = "    "


def format(node: Problem | Formula) -> str:
    """Returns BDDL text: a formula on one line, a problem as an indented file that ends in a newline.

    Args:
        node: A formula or a problem.

    Returns:
        Text for which `parse_formula` or `parse` returns an equal tree.

    Example:
        >>> import bddl
        >>> bddl.format(bddl.Not(bddl.Atom("open", ("refrigerator_0",))))
        '(not (open refrigerator_0))'
    """
    return _problem_text(node) if isinstance(node, Problem) else formula_text(node)


def _problem_text(problem: Problem) -> str:
    objects = [
        f"{' '.join(item.name for item in group)} - {category}"
        for category, group in groupby(problem.objects, key=lambda item: item.category)
    ]
    goal = (
        ["(and", *(f"{_INDENT}{formula_text(part)}" for part in problem.goal.parts), ")"]
        if isinstance(problem.goal, And) and problem.goal.parts
        else [formula_text(problem.goal)]
    )
    lines = [
        f"(define (problem {problem.name})",
        f"{_INDENT}(:domain {problem.domain})",
        *_section_lines(":objects", objects),
        *_section_lines(":init", [formula_text(literal) for literal in problem.init]),
        *_section_lines(":goal", goal),
        ")",
    ]
    return "\n".join(lines) + "\n"


def _section_lines(head: str, content: list[str]) -> list[str]:
    """Returns the lines of one section, indented inside `define`; an empty one stays on one line."""
    if not content:
        return [f"{_INDENT}({head})"]
    return [f"{_INDENT}({head}", *(f"{_INDENT * 2}{line}" for line in content), f"{_INDENT})"]
