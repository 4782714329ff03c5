"""The doors of the package: text to formula, text to problem, and mistakes as data."""

from __future__ import annotations

from importlib import import_module
from typing import cast

from bddl.printer import format
from bddl.reading.reader import Subject, Wanted, read_text
from bddl.syntax.diagnostic import BDDLError, Diagnostic
from bddl.syntax.problem import Domain, Objects, Problem, categories_of
from bddl.syntax.profiles import Profile, find_profile, report_other_dialect
from bddl.syntax.tree import Formula


def parse(
    text: str, profile: str | Profile = "scene", objects: Objects | None = None, domain: Domain | None = None
) -> Problem:
    """Returns the problem that a text defines.

    Args:
        text: A form `(define (problem NAME) (:domain NAME) (:objects ...) (:init ...) (:goal ...))`.
        profile: The dialect, or its name.
        objects: Category of each object of the scene. When given, the problem may use them without declaring them,
            and may declare no others.
        domain: The domain that the problem must belong to, whose predicates it may use; by default the profile has
            them, by the name that the problem gives.

    Returns:
        The problem, with the place of every node in the text; its `warnings` has what the profile tolerates.

    Raises:
        BDDLError: The text is not legal; its `diagnostics` has every mistake that was found.
        UnknownProfile: There is no such profile.
    """
    return cast(Problem, read(text, "problem", profile, objects, domain)[0])


def parse_formula(
    text: str, profile: str | Profile = "scene", objects: Objects | None = None, domain: Domain | None = None
) -> Formula:
    """Returns the formula that a text says.

    Args:
        text: One formula, such as `(not (open refrigerator_0))`.
        profile: The dialect, or its name.
        objects: Category of each object of the scene; when given, a name that is none of them is a mistake. Without
            it any name may be an object.
        domain: The domain whose predicates the formula may use; by default those of the profile.

    Returns:
        The formula, with the place of every node in the text.

    Raises:
        BDDLError: The text is not legal; its `diagnostics` has every mistake that was found.
        UnknownProfile: There is no such profile.

    Example:
        >>> import bddl
        >>> bddl.parse_formula("(and (open refrigerator_0) (inside glass_0 gripper))").parts[1]
        <Atom (inside glass_0 gripper)>
    """
    return cast(Formula, read(text, "formula", profile, objects, domain)[0])


def check(
    subject: str | Subject,
    profile: str | Profile = "scene",
    objects: Objects | None = None,
    domain: Domain | None = None,
) -> tuple[Diagnostic, ...]:
    """Returns the mistakes in a formula, a problem or a domain as data, none when it is legal.

    Args:
        subject: A text, or a tree. The places in the diagnostics of a tree refer to what `format` prints for it.
        profile: The dialect, or its name.
        objects: Category of each object of the scene; when given, unknown objects and categories are mistakes too.
        domain: The domain whose predicates may be used; by default those of the profile.

    Returns:
        The diagnostics, in the order of their places; those of severity "warning" are tolerated by the profile.

    Raises:
        UnknownProfile: There is no such profile.

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
        _, warnings = read(text, "any", profile, objects, domain)
    except BDDLError as error:
        return error.diagnostics
    return warnings


def parse_domain(text: str) -> Domain:
    """Returns the domain that a text defines.

    Letter case is of no account in a domain's predicates, types and requirements, which are read in lower case.

    Args:
        text: A form `(define (domain NAME) (:requirements ...) (:types ...) (:predicates ...) (:action ...))`.

    Returns:
        The domain, with the place of every declaration in the text.

    Raises:
        BDDLError: The text is not legal; its `diagnostics` has every mistake that was found.

    Example:
        >>> import bddl
        >>> domain = bddl.parse_domain("(define (domain d) (:predicates (open ?a) (ontop ?a ?b - table)))")
        >>> [(predicate.name, predicate.arity) for predicate in domain.predicates]
        [('open', 1), ('ontop', 2)]
    """
    return cast(Domain, read(text, "domain", "behavior", None)[0])


def read(
    text: str, wanted: Wanted, profile: str | Profile, objects: Objects | None, domain: Domain | None = None
) -> tuple[Subject, tuple[Diagnostic, ...]]:
    """Returns what a text says, of the kind that is wanted, and what was found that did not keep it from being read.

    Raises:
        BDDLError: The text is not legal.
        UnknownProfile: There is no such profile.
    """
    dialect, known = find_profile(profile), None if objects is None else categories_of(objects)
    reading = read_text(text, wanted, dialect, known, domain)
    if reading.found is None:
        # Loaded with the first mistake: legal texts never need what is known about slips.
        report_other_dialect(text, reading.profile, reading.reporter)
        raise BDDLError(import_module("bddl.repair.correction").labelled(reading, known))
    return reading.found, reading.reporter.diagnostics
