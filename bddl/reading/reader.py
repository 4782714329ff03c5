"""From text to what it says: a formula, a problem or a domain, with everything that was found on the way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal, TypeAlias

from bddl.reading.domain_reader import read_domain
from bddl.reading.forms import FormulaReader
from bddl.reading.parentheses import repair
from bddl.reading.problem_reader import read_problem
from bddl.reading.words import (
    Forest,
    Group,
    Word,
    hide_free_text,
    is_call,
    read_forest,
    read_words,
    regroup,
    to_prefix,
    words_of,
)
from bddl.syntax.codes import Code
from bddl.syntax.diagnostic import Reporter, Source
from bddl.syntax.names import near_names
from bddl.syntax.problem import Domain, Problem
from bddl.syntax.profiles import Profile
from bddl.syntax.tree import Formula

_Kind: TypeAlias = Literal["formula", "problem", "domain"]
Wanted: TypeAlias = Literal["formula", "problem", "domain", "any"]

# What is still worth reporting after parentheses were repaired: mistakes that no repair brings about.
_AFTER_REPAIR: tuple[Code, ...] = (
    "unknown-predicate",
    "unknown-object",
    "unknown-category",
    "unbound-variable",
    "unsupported-form",
    "wrong-arity",
    "bad-name",
    "function-notation",
    "markdown-fence",
    "several-formulas",
    "text-around",
    "wrong-kind",
)


Subject: TypeAlias = Formula | Problem | Domain


@dataclass(frozen=True, slots=True)
class TextReading:
    """What came of reading a text.

    Attributes:
        found: What the text says, or None when it is wrong.
        profile: The dialect that it was read in, with the predicates of its domain.
        reporter: Has the text and what was found in it.
        forest: The forms and loose words of the text, their parentheses put right where that was needed.
    """

    found: Subject | None
    profile: Profile
    reporter: Reporter
    forest: Forest


def read_text(
    text: str, wanted: Wanted, profile: Profile, objects: Mapping[str, str] | None, domain: Domain | None = None
) -> TextReading:
    """Reads a text.

    Args:
        text: The text.
        wanted: What it should be: a formula, a problem, a domain, or any of them.
        profile: The dialect.
        objects: Category of each object of the scene, or None when they are not checked.
        domain: The domain whose predicates may be used; by default those of the profile.

    Raises:
        TypeError: The text is no string.
    """
    if not isinstance(text, str):
        raise TypeError(f"BDDL text is a str, not {type(text).__name__}.")
    dialect = profile if domain is None else profile.for_domain(domain.specs)
    reporter = Reporter(text, dialect.tolerated)
    if dialect.free_text:
        reporter.source = Source(hide_free_text(text, dialect.free_text))
    results: list[Subject | None] = []
    forest, groups = _open(wanted, dialect, reporter)
    for group in groups:
        kind = _kind_of(group)
        if kind == "problem":
            results.append(read_problem(group, dialect, objects, domain, reporter))
        elif kind == "domain":
            results.append(read_domain(group, reporter))
        else:
            results.append(FormulaReader(dialect, objects, reporter).read(group))
    found = results[0] if len(results) == 1 and not reporter else None
    if reporter.diagnostics and isinstance(found, Problem | Domain):
        found = replace(found, warnings=reporter.diagnostics)
    return TextReading(found, dialect, reporter, forest)


def _open(wanted: Wanted, profile: Profile, reporter: Reporter) -> tuple[Forest, list[Group]]:
    """Returns the forms of the reporter's text that should be read, one when the text is as it should be.

    Args:
        wanted: What the text should be: a formula, a problem, a domain, or any of them.
        profile: The dialect.
        reporter: Receives a diagnostic for everything that is not that one form.

    Returns:
        All forms and loose words, with matching parentheses, and the forms worth reading; of these there are more than
        one, or none, only when something was reported.
    """
    forest = read_forest(reporter.source)
    if forest is None:
        forest = regroup(repair(read_words(reporter.source), profile, reporter))
        reporter.restrict(_AFTER_REPAIR)
    groups = [item for item in forest if isinstance(item, Group)]
    words = [item for item in forest if isinstance(item, Word)]
    if not groups:
        _report_no_form(words, reporter)
        return forest, []
    if words:
        groups = _unwrap(forest, groups, words, profile, reporter)
    if len(groups) > 1:
        _report_several(groups, reporter)
    for group in groups:
        if group.head is not None and group.head.key != "define" and _is_misspelt_define(group):
            _report_misspelt_define(group.head, reporter)
    return forest, [group for group in groups if _is_wanted(group, wanted, profile, reporter)]


def _kind_of(group: Group) -> _Kind:
    """Returns what a form is; whatever defines something is a problem unless it says that it is a domain."""
    if group.head is None or not (group.head.key == "define" or _is_misspelt_define(group)):
        return "formula"
    titles = (item.head for item in group.items[1:] if isinstance(item, Group))
    return "domain" if any(title is not None and title.key == "domain" for title in titles) else "problem"


def _is_misspelt_define(group: Group) -> bool:
    """Decides whether a form is a definition, to judge by what it holds, though its first word is not `define`."""
    inner = [item.head for item in group.items[1:] if isinstance(item, Group)]
    holds = any(head is not None and (head.kind == "SECTION" or head.key in ("problem", "domain")) for head in inner)
    return holds and group.head is not None and bool(near_names(group.head.text, ("define",)))


def _report_misspelt_define(head: Word, reporter: Reporter) -> None:
    reporter.add(
        "unknown-predicate",
        head.span,
        f"A problem or a domain begins with `define`, not with `{head.text}`.",
        expected=("define",),
        hint="did you mean define?",
    )


def _report_no_form(words: Sequence[Word], reporter: Reporter) -> None:
    if not words:
        reporter.add(
            "empty-text",
            reporter.place(0),
            "The text holds no formula.",
            expected=("(",),
            hint="write a formula such as (open refrigerator_0); the empty condition is (and)",
        )
        return
    reporter.add(
        "no-parentheses",
        reporter.place(words[0].offset, words[-1].end - words[0].offset),
        "There is no parenthesis in the text, and every formula stands in a pair of them.",
        expected=("(",),
        hint="write a formula such as (open refrigerator_0)",
        whole=True,
    )


def _unwrap(
    forest: Forest, groups: list[Group], words: Sequence[Word], profile: Profile, reporter: Reporter
) -> list[Group]:
    """Reports the loose words of a text and returns the forms that look like BDDL, or all when none does."""
    first = forest[0]
    if isinstance(first, Word) and is_call(forest) and _opens_formula(first, profile):
        reporter.add(
            "function-notation",
            first.span,
            "In BDDL the predicate stands inside the parentheses.",
            expected=("(",),
            hint="write (NAME ARGUMENT ...)",
            whole=True,
        )
        return [item for item in regroup(to_prefix(words_of(forest))) if isinstance(item, Group)]
    likely = likely_forms(groups, profile, with_prose=True) or groups
    hint = "give the BDDL text alone; a comment begins with ;"
    fence = next((word for word in words if word.text.startswith(("```", "~~~"))), None)
    if fence is not None:
        reporter.add(
            "markdown-fence",
            fence.span,
            "The text is wrapped in a Markdown code fence, which is no BDDL.",
            expected=("(",),
            hint=hint,
            whole=True,
        )
    else:
        reporter.add(
            "text-around",
            words[0].span,
            f"The word `{words[0].text}` stands outside the formula"
            + (f", and so {'does' if len(words) == 2 else 'do'} {len(words) - 1} more." if len(words) > 1 else "."),
            expected=("(",),
            hint=hint,
            whole=True,
        )
    return likely


def likely_forms(groups: Sequence[Group], profile: Profile, *, with_prose: bool) -> list[Group]:
    """Returns those forms of a text that look like BDDL; there may be none."""
    likely = [group for group in groups if group.head is not None and _opens_formula(group.head, profile)]
    # Parentheses of prose may begin with a word of the language, too; what is built like a formula comes first.
    built = [group for group in likely if with_prose and _is_built_like_one(group, profile)]
    return built or likely


def _is_built_like_one(group: Group, profile: Profile) -> bool:
    """Decides whether a form with a known first word holds what such a form holds: names, or forms."""
    head = group.head
    if head is None:
        return False
    spec = profile.predicates.get(head.key)
    if spec is not None:
        return len(group.items) == spec.arity + 1
    known = head.key in profile.forms or head.key == "define"
    return known and (len(group.items) == 1 or any(isinstance(item, Group) for item in group.items))


def _opens_formula(word: Word, profile: Profile) -> bool:
    known = (*profile.words, *profile.absent_forms, "define", "problem", *profile.sections)
    return word.key in known or bool(near_names(word.text, profile.words))


def _report_several(groups: Sequence[Group], reporter: Reporter) -> None:
    formulas = all(_kind_of(group) == "formula" for group in groups)
    reporter.add(
        "several-formulas",
        groups[1].span,
        f"The text holds {len(groups)} forms, and only one belongs in it.",
        expected=("end of text",),
        hint="join them with (and ...)" if formulas else "give each problem a text of its own",
        related=groups[0].span,
        whole=formulas,
    )


def _is_wanted(group: Group, wanted: Wanted, profile: Profile, reporter: Reporter) -> bool:
    found = _kind_of(group)
    if wanted in ("any", found):
        return True
    sentence, expected, hint = _WANTED[wanted]
    reporter.add("wrong-kind", group.opened.span, sentence.format(found), expected=expected or profile.words, hint=hint)
    return False


# For each kind of text: what to say when it is another, what belongs there, and which function reads it.
_WANTED: Mapping[Wanted, tuple[str, tuple[str, ...], str]] = MappingProxyType(
    {
        "formula": ("A formula belongs here, not a {}.", (), "read a problem with bddl.parse"),
        "problem": (
            "A problem belongs here, and it begins with (define (problem NAME).",
            ("define",),
            "read a formula with bddl.parse_formula, a domain with bddl.parse_domain",
        ),
        "domain": (
            "A domain belongs here, and it begins with (define (domain NAME).",
            ("define",),
            "read a problem with bddl.parse, a formula with bddl.parse_formula",
        ),
    }
)
