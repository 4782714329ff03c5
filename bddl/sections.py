"""From the form `(define ...)` to a problem: its name, domain, objects, initial literals and goal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bddl.diagnostics import Reporter
from bddl.forest import Group, Item, Word
from bddl.forms import FormulaReader
from bddl.names import near_names
from bddl.problem import Problem, TypedObject
from bddl.profiles import Profile
from bddl.syntax import Atom, Formula, Not
from bddl.terms import TermReader
from bddl.truth import ROOT_CATEGORY


class ProblemReader:
    """Reads one problem.

    Args:
        profile: The dialect.
        objects: Objects that exist besides those declared, or None; when given, a declared object must be among them.
        reporter: Receives the diagnostics.
    """

    def __init__(self, profile: Profile, objects: Mapping[str, str] | None, reporter: Reporter) -> None:
        self._profile = profile
        self._objects = objects
        self._reporter = reporter

    def read(self, group: Group) -> Problem | None:
        """Returns the problem, or None when something in it was wrong and has been reported."""
        sections = self._collect(group)
        name = self._single_name(sections.get("problem"))
        domain = self._single_name(sections.get(":domain"))
        objects = self._read_objects(sections.get(":objects"))
        known = {**(self._objects or {}), **{item.name: item.category for item in objects}}
        reader = FormulaReader(self._profile, known, self._reporter)
        init = self._read_init(sections.get(":init"), reader)
        goal = self._read_goal(sections.get(":goal"), reader)
        if self._reporter or goal is None:
            return None
        return Problem(name, domain, tuple(objects), tuple(init), goal, span=group.span)

    def _collect(self, group: Group) -> dict[str, Group]:
        """Returns the sections by name; reports unknown, repeated and missing ones and whatever is no section."""
        legal = ("problem", *self._profile.sections)
        found: dict[str, Group] = {}
        misspelt: set[str] = set()
        for item in group.items[1:]:
            head = item.head if isinstance(item, Group) else None
            if not isinstance(item, Group) or head is None:
                self._reporter.add(
                    "bad-section",
                    item.span,
                    "A section belongs here.",
                    expected=legal,
                    hint=f"the sections are: {', '.join(f'({word} ...)' for word in legal)}",
                )
            elif head.key in self._profile.ignored_sections:
                continue
            elif head.key not in legal:
                near = near_names(head.key, legal)
                misspelt.update(near[:1])
                self._reporter.add(
                    "unknown-section",
                    head.span,
                    f"The profile `{self._profile.name}` has no section `{head.text}`.",
                    expected=near or legal,
                    hint=f"did you mean {near[0]}?" if near else f"the sections are: {', '.join(legal)}",
                )
            elif head.key in found:
                self._reporter.add(
                    "repeated-section",
                    head.span,
                    f"The section `{head.key}` is there twice.",
                    hint="put everything into one of them",
                    related=found[head.key].span,
                )
            else:
                found[head.key] = item
        for name in ("problem", *self._profile.required_sections):
            if name not in found and name not in misspelt:
                self._reporter.add(
                    "missing-section",
                    group.opened.span,
                    f"The problem has no section `{name}`.",
                    expected=(name,),
                    hint=f"add ({name} ...)",
                )
        return found

    def _single_name(self, section: Group | None) -> str:
        """Returns the one name that a section holds; the text "unnamed" stands in for one that was reported."""
        if section is None:
            return "unnamed"
        items = section.items[1:]
        only = items[0] if len(items) == 1 else None
        if isinstance(only, Word) and only.kind == "NAME":
            return only.text
        head = section.head
        self._reporter.add(
            "bad-section",
            section.span,
            "One name belongs here.",
            expected=("NAME",),
            hint=f"write ({head.text if head else 'problem'} NAME)",
        )
        return "unnamed"

    def _read_objects(self, section: Group | None) -> list[TypedObject]:
        if section is None:
            return []
        terms = TermReader(self._profile, self._objects, self._reporter)
        declared: dict[str, TypedObject] = {}
        items = section.items[1:]
        start = 0
        while start < len(items):
            hyphen = start
            while hyphen < len(items) and not _is_hyphen(items[hyphen]):
                hyphen += 1
            names = self._names_only(items[start:hyphen])
            category = ROOT_CATEGORY
            if hyphen < len(items):
                category = self._category(items[hyphen : hyphen + 2], names, terms)
            for word in names:
                self._declare(word, category, declared, terms)
            start = hyphen + 2
        return list(declared.values())

    def _category(self, pair: Sequence[Item], names: Sequence[Word], terms: TermReader) -> str:
        """Returns the category behind a hyphen; the root category stands in for one that was reported."""
        category = pair[1] if len(pair) == 2 else None
        if not names or not isinstance(category, Word) or _is_hyphen(category):
            self._reporter.add(
                "bad-objects",
                pair[0].span,
                "Names belong before this hyphen, and one category behind it.",
                expected=("NAME ... - CATEGORY",),
                hint="write (:objects glass_0 - glass)",
            )
            return ROOT_CATEGORY
        return terms.category(category) or ROOT_CATEGORY

    def _declare(self, word: Word, category: str, declared: dict[str, TypedObject], terms: TermReader) -> None:
        name = terms.declare(word)
        if name is None:
            return
        if name in declared:
            self._reporter.add(
                "repeated-object",
                word.span,
                f"The object `{name}` is declared twice.",
                hint="declare it once, with one category",
                related=declared[name].span,
            )
            return
        terms.check_known(name, word.span)
        declared[name] = TypedObject(name, category, span=word.span)

    def _names_only(self, items: Sequence[Item]) -> list[Word]:
        for item in items:
            if isinstance(item, Group):
                self._reporter.add(
                    "not-a-name",
                    item.span,
                    "The name of an object belongs here, not a form in parentheses.",
                    expected=("NAME",),
                    hint="write (:objects glass_0 - glass)",
                )
        return [item for item in items if isinstance(item, Word)]

    def _read_init(self, section: Group | None, reader: FormulaReader) -> list[Formula]:
        literals: list[Formula] = []
        for item in section.items[1:] if section is not None else ():
            formula = reader.read(item)
            if formula is None:
                continue
            if isinstance(formula.body if isinstance(formula, Not) else formula, Atom):
                literals.append(formula)
            else:
                self._reporter.add(
                    "bad-init",
                    item.span,
                    "The section :init lists literals: atoms and negated atoms.",
                    expected=("(PREDICATE NAME ...)", "(not (PREDICATE NAME ...))"),
                    hint="list the literals one after the other, without (and ...)",
                )
        return literals

    def _read_goal(self, section: Group | None, reader: FormulaReader) -> Formula | None:
        if section is None or section.head is None:
            return None
        goals = [reader.read(item) for item in section.items[1:]]
        if len(goals) == 1:
            return goals[0]
        parts = [self._reporter.quote(item.span) for item in section.items[1:]]
        if goals:
            self._reporter.add(
                "several-formulas",
                section.items[2].span,
                f"The section :goal holds {len(goals)} formulas, and only one belongs in it.",
                expected=(")",),
                hint=f"write (:goal (and {' '.join(parts)}))" if all(parts) else "join them with (and ...)",
                related=section.items[1].span,
            )
        else:
            self._reporter.add(
                "bad-section",
                section.head.span,
                "The section :goal holds no formula.",
                expected=("(",),
                hint="write (:goal FORMULA); a goal that always holds is (and)",
            )
        return None


def _is_hyphen(item: Item) -> bool:
    return isinstance(item, Word) and item.kind == "HYPHEN"
