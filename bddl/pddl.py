"""Problems that are read by their domain: its predicates and its types, in files of their own or in one text."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from bddl.ast import And, Exists, ForAll, Formula, FormulaNode, Imply, Not, Or, Quantified
from bddl.diagnostics import BDDLError, Reporter, Source
from bddl.dialects import PredicateSpec, Profile
from bddl.lexer import Group, group_words, read_words
from bddl.problem import ROOT_CATEGORY, Domain, Problem

_DEFINITION = re.compile(r"\(\s*define\b", re.IGNORECASE)
_VISIBLE = re.compile(r"\S")


def split_domain(text: str) -> tuple[str, str] | None:
    """Return the domain and the problem of a text that defines both; None for any other text.

    In either, blanks stand for the other one, so that places are those of the text.
    """
    if len(_DEFINITION.findall(text)) != 2:
        return None
    forest = group_words(read_words(Source(text))) or ()
    forms = [item for item in forest if isinstance(item, Group)]
    if len(forms) != 2 or len(forest) != 2:
        return None
    defined = [_defined(form) for form in forms]
    if set(defined) != {"domain", "problem"}:
        return None
    texts = {
        kind: text[: form.offset] + _VISIBLE.sub(" ", text[form.offset : form.end]) + text[form.end :]
        for kind, form in zip(defined, forms, strict=True)
    }
    return texts["problem"], texts["domain"]


def _defined(form: Group) -> str:
    titles = [item.head.key for item in form.items[1:2] if isinstance(item, Group) and item.head is not None]
    return titles[0] if titles else ""


def profile_of(domain: Domain, profile: Profile) -> Profile:
    """Return a dialect with the predicates and the types of a domain in place of its own.

    Names are read in lower case, as in PDDL.
    """
    specs = {
        predicate.name: PredicateSpec(predicate.name, tuple(f"?{name}" for name, _ in predicate.parameters), "")
        for predicate in domain.predicates
    }
    types = {ROOT_CATEGORY} | {name for item in domain.types for name in (item.name, item.category)}
    return replace(
        profile,
        name=f"{profile.name} of the domain {domain.name}",
        predicates=MappingProxyType(specs),
        domains=MappingProxyType({domain.name.lower(): MappingProxyType(specs)}),
        folds_case=True,
        types=frozenset(types),
        typed=bool(domain.types),
        ignored_sections=(*profile.ignored_sections, ":metric"),
        rules=profile.rules | {"types"},
    )


def spread_types(problem: Problem, domain: Domain, text: str) -> Problem:
    """Return the problem with each quantifier over a type with subtypes as one quantifier for each of them.

    Raises:
        BDDLError: A form that counts ranges over such a type.
    """
    parents = {item.name: item.category for item in domain.types}
    held = {category: _line(category, parents) for category in dict.fromkeys(problem.categories.values())}
    reporter = Reporter(text)
    done: dict[int, Formula] = {}
    # Inner nodes come last in a walk.
    for node in reversed(list(problem.goal.walk())):
        done[id(node)] = _spread(node, [done[id(one)] for one in node.operands], held, reporter)
    if reporter:
        raise BDDLError(reporter.diagnostics)
    return replace(problem, goal=done[id(problem.goal)])


def _line(category: str, parents: Mapping[str, str]) -> tuple[str, ...]:
    """Return a type and all its supertypes; a cycle ends where it closes."""
    found = [category]
    while parents.get(found[-1], ROOT_CATEGORY) not in (*found, ROOT_CATEGORY):
        found.append(parents[found[-1]])
    return tuple(found)


def _spread(
    node: FormulaNode, parts: list[Formula], held: Mapping[str, tuple[str, ...]], reporter: Reporter
) -> Formula:
    if isinstance(node, Quantified):
        inside: Quantified = replace(node, body=parts[0])  # type: ignore[call-arg]
        for binder in node.binders:
            below = [category for category, line in held.items() if binder.category in line]
            if binder.category == ROOT_CATEGORY or below in ([], [binder.category]):
                continue
            if not isinstance(inside, ForAll | Exists):
                if node.span is not None:
                    kinds = ", ".join(below)
                    message = f"A form that counts cannot range over `{binder.category}`, whose objects are {kinds}."
                    reporter.add("unsupported-form", node.span, message, hint=f"count one of them: {kinds}")
                continue
            copies = tuple(replace(inside, category=category) for category in below)
            join = And if isinstance(inside, ForAll) else Or
            return copies[0] if len(copies) == 1 else join(copies, span=node.span)
        return inside  # type: ignore[return-value]
    if isinstance(node, And | Or):
        return replace(node, parts=tuple(parts))
    if isinstance(node, Not):
        return replace(node, body=parts[0])
    if isinstance(node, Imply):
        return replace(node, left=parts[0], right=parts[1])
    return node  # type: ignore[return-value]
