"""Parse texts to formulas, problems and domains, or list their mistakes as data.

`parse`, `parse_formula`, `parse_domain` and `check` are the public functions; `read_text` is their common core.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from types import MappingProxyType
from typing import Literal, TypeAlias, cast

from bddl.ast import Formula
from bddl.definitions import read_domain, read_problem
from bddl.diagnostics import BDDLError, Code, Diagnostic, Reporter, Source
from bddl.dialects import Profile, find_profile, near_names, report_other_dialect
from bddl.direct import read_directly
from bddl.formulas import FormulaReader
from bddl.lexer import (
    Forest,
    Group,
    Word,
    group_words,
    hide_free_text,
    is_call,
    read_words,
    to_prefix,
    words_of,
)
from bddl.pddl import profile_of, split_domain, spread_types
from bddl.printer import format
from bddl.problem import Domain, Objects, Problem, categories_of
from bddl.recovery import recover_parentheses


def parse(
    text: str,
    profile: str | Profile = "scene",
    objects: Objects | None = None,
    domain: Domain | str | None = None,
) -> Problem:
    """Return the problem that a text defines; its `warnings` has what the profile tolerates.

    Args:
        text: A form `(define (problem NAME) (:domain NAME) (:objects ...) (:init ...) (:goal ...))`.
        profile: The dialect, or its name; "auto" finds it by the text's domain and its style.
        objects: Category of each object of the scene. When given, the problem may use them without declaring them,
            and may declare no others.
        domain: The domain that the problem belongs to, or its text, whose predicates and types are then the legal
            ones. A text may also define both. A quantifier over a type becomes one for each of its subtypes.

    Raises:
        BDDLError: The text is not legal; its `diagnostics` has every mistake that was found.
        UnknownProfile: There is no such profile.
    """
    return cast(Problem, read(text, "problem", profile, objects, domain)[0])


def parse_formula(text: str, profile: str | Profile = "scene", objects: Objects | None = None) -> Formula:
    """Return the formula of a text, with the place of every node; arguments and errors are those of `parse`.

    Without objects any name may be an object.

    Example:
        >>> import bddl
        >>> bddl.parse_formula("(and (open refrigerator_0) (inside glass_0 gripper))").parts[1]
        <Atom (inside glass_0 gripper)>
    """
    return cast(Formula, read(text, "formula", profile, objects)[0])


def read_formula(given: Formula | str, profile: str | Profile = "auto") -> Formula:
    """Return a formula as it is, and a text as the formula that it is."""
    return parse_formula(given, profile) if isinstance(given, str) else given


def check(
    subject: str | Subject, profile: str | Profile = "scene", objects: Objects | None = None
) -> tuple[Diagnostic, ...]:
    """Return the mistakes in a formula, a problem or a domain as data, none when it is legal.

    Args:
        subject: A text, or a tree. The places in the diagnostics of a tree refer to what `format` prints for it.
        objects: Category of each object of the scene; when given, unknown objects and categories are mistakes too.

    Example:
        >>> import bddl
        >>> print(bddl.check("(not (open refrigerator_0)")[0])
        line 1, column 27: A closing parenthesis is missing: the one opened at line 1, column 1 is never closed. \
[missing-parenthesis]
        1 | (not (open refrigerator_0)
          | -                         ^
        hint: write (not (open refrigerator_0))
        >>> [found.hint for found in bddl.check("(on cup_0 table_0)", objects={"glass_0": "glass", "table_0": "table"})]
        ['write (ontop cup_0 table_0)', 'did you mean glass_0?']
    """
    text = subject if isinstance(subject, str) else format(subject)
    try:
        _, warnings = read(text, "any", profile, objects)
    except BDDLError as error:
        return error.diagnostics
    return warnings


def parse_domain(text: str) -> Domain:
    """Return the domain that a text defines.

    Letter case is of no account in a domain's predicates, types and requirements, which are read in lower case.

    Example:
        >>> import bddl
        >>> domain = bddl.parse_domain("(define (domain d) (:predicates (open ?a) (ontop ?a ?b - table)))")
        >>> [(predicate.name, predicate.arity) for predicate in domain.predicates]
        [('open', 1), ('ontop', 2)]
    """
    return cast(Domain, read(text, "domain", "behavior", None)[0])


def read(
    text: str, wanted: Wanted, profile: str | Profile, objects: Objects | None, domain: Domain | str | None = None
) -> tuple[Subject, tuple[Diagnostic, ...]]:
    """Return the content of a text, of the wanted kind, and the findings that the profile tolerates."""
    if not isinstance(text, str):
        raise TypeError(f"BDDL text is a str, not {type(text).__name__}.")
    dialect = find_profile(profile, text)
    known = None if objects is None else categories_of(objects)
    if domain is None:
        direct = read_directly(text, wanted, dialect, known)
        if direct is not None:
            return direct
        both = split_domain(text) if wanted in ("problem", "any") else None
        if both is not None:
            domain, text = both
    if domain is not None:
        given = parse_domain(domain) if isinstance(domain, str) else domain
        found, warnings = read(text, "problem", profile_of(given, dialect), known)
        return spread_types(cast(Problem, found), given, text), warnings
    reading = read_text(text, wanted, dialect, known)
    if reading.found is None:
        # Imported with the first mistake: legal texts never need the rewriters.
        report_other_dialect(text, reading.profile, reading.reporter)
        raise BDDLError(import_module("bddl.repair").label_slips(reading, known))
    return reading.found, reading.reporter.diagnostics


_Kind: TypeAlias = Literal["formula", "problem", "domain"]
Wanted: TypeAlias = Literal["formula", "problem", "domain", "any"]

# Codes that are still reported after parentheses were recovered: no recovery causes these mistakes.
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
    """Result of reading a text.

    Attributes:
        found: The content of the text, or None when it is wrong.
        forest: The forms and loose words of the text, with recovered parentheses where that was needed.
    """

    found: Subject | None
    profile: Profile
    reporter: Reporter
    forest: Forest


def read_text(text: str, wanted: Wanted, profile: Profile, objects: Mapping[str, str] | None) -> TextReading:
    """Read a text and collect its diagnostics."""
    reporter = Reporter(text, profile.tolerated)
    if profile.free_text:
        reporter.source = Source(hide_free_text(text, profile.free_text))
    results: list[Subject | None] = []
    forest, groups = _select_forms(wanted, profile, reporter)
    for group in groups:
        kind = _kind_of(group)
        if kind == "problem":
            results.append(read_problem(group, profile, objects, reporter))
        elif kind == "domain":
            results.append(read_domain(group, reporter))
        else:
            results.append(FormulaReader(profile, objects, reporter).read(group))
    found = results[0] if len(results) == 1 and not reporter else None
    if reporter.diagnostics and isinstance(found, Problem | Domain):
        found = replace(found, warnings=reporter.diagnostics)
    return TextReading(found, profile, reporter, forest)


def _select_forms(wanted: Wanted, profile: Profile, reporter: Reporter) -> tuple[Forest, list[Group]]:
    """Return the forms of the reporter's text that are to be read: one when the text is legal."""
    words_read = read_words(reporter.source)
    forest = group_words(words_read)
    if forest is None:
        forest = group_words(recover_parentheses(words_read, profile, reporter)) or ()
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
    """Return the kind of a form; every definition is a problem unless its title is `domain`."""
    if group.head is None or not (group.head.key == "define" or _is_misspelt_define(group)):
        return "formula"
    titles = (item.head for item in group.items[1:] if isinstance(item, Group))
    return "domain" if any(title is not None and title.key == "domain" for title in titles) else "problem"


def _is_misspelt_define(group: Group) -> bool:
    """Decide by its content whether a form is a definition, though its first word is not `define`."""
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
    """Report the loose words of a text and returns the forms that look like BDDL, or all when none does."""
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
        return [item for item in group_words(to_prefix(words_of(forest))) or () if isinstance(item, Group)]
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
    """Return those forms of a text that look like BDDL; there may be none."""
    likely = [group for group in groups if group.head is not None and _opens_formula(group.head, profile)]
    # Parentheses of prose may begin with a word of the language, too; what is built like a formula comes first.
    built = [group for group in likely if with_prose and _is_built_like_one(group, profile)]
    return built or likely


def _is_built_like_one(group: Group, profile: Profile) -> bool:
    """Decide whether a form with a known first word has the content of such a form: names, or forms."""
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
