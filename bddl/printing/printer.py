"""From the syntax tree to text. Parsing what is printed gives back an equal tree."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby

from bddl.syntax import And, Binder, Formula, Node, formula_text
from bddl.syntax.libero import LiberoProblem, Region, SceneStyle
from bddl.syntax.problem import ROOT_CATEGORY, Domain, Problem, TypedObject

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
    if not isinstance(node, Node):
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
