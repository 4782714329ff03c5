"""From the form `(define (domain ...) ...)` to a domain."""

from __future__ import annotations

from collections.abc import Sequence

from bddl.reading.sections import UNNAMED, SectionNames, collect_sections, read_name, report_unknown
from bddl.reading.words import Group, Item, Word, form_text, words_in
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.problem import ROOT_CATEGORY, Domain, DomainAction, DomainPredicate, TypedObject
from bddl.syntax.tree import RESERVED_WORDS, Binder, is_name

# What a domain may ask of those who read it; only the names are known here.
REQUIREMENTS = (":strips", ":negative-preconditions", ":typing", ":adl")
_SECTIONS = ("domain", ":requirements", ":types", ":predicates", ":action")


def read_domain(group: Group, reporter: Reporter) -> Domain:
    """Returns the domain that a form defines; what is wrong in it is reported and left out.

    Source: the reference implementation, `parse_domain`, which reads the name of every action as `:parameters`.
    """
    names = SectionNames("language", "domain", _SECTIONS, ("domain", ":predicates"), repeatable=(":action",))
    sections = collect_sections(group, names, reporter)
    title = read_name(sections["domain"][0], reporter) if "domain" in sections else None
    inside = {name: [item for section in found for item in section.items[1:]] for name, found in sections.items()}
    types = _typed(inside.get(":types", ()), reporter, "TYPE ... - SUPERTYPE")
    return Domain(
        UNNAMED if title is None else title.text,
        _requirements(inside.get(":requirements", ()), reporter),
        tuple(TypedObject(word.key, kind, span=word.span) for word, kind in types if is_name(word.key)),
        _predicates(inside.get(":predicates", ()), reporter),
        _actions(sections.get(":action", ()), reporter),
        span=group.span,
    )


def _requirements(items: Sequence[Item], reporter: Reporter) -> tuple[str, ...]:
    for item in items:
        key = item.key if isinstance(item, Word) else ""
        if key not in REQUIREMENTS:
            message = f"There is no requirement `{reporter.quote(item.span)}`."
            report_unknown(reporter, "unknown-requirement", item.span, message, key, REQUIREMENTS)
    return tuple(word.key for word in words_in(items))


def _predicates(items: Sequence[Item], reporter: Reporter) -> tuple[DomainPredicate, ...]:
    found: dict[str, DomainPredicate] = {}
    for item in items:
        head = item.head if isinstance(item, Group) else None
        if not isinstance(item, Group) or head is None or head.kind != "NAME" or head.key in RESERVED_WORDS:
            reporter.add(
                "bad-predicate",
                item.span,
                "The declaration of a predicate belongs here.",
                expected=("(NAME ?a ?b)",),
                hint="write the predicate with its parameters, such as (ontop ?item ?support)",
            )
        elif head.key in found:
            reporter.add(
                "repeated-predicate",
                head.span,
                f"The predicate `{head.key}` is declared twice.",
                hint="declare it once",
                related=found[head.key].span,
            )
        else:
            parameters = _parameters(_typed(item.items[1:], reporter, "?a ?b - TYPE"), reporter)
            found[head.key] = DomainPredicate(head.key, parameters, span=item.span)
    return tuple(found.values())


def _parameters(pairs: Sequence[tuple[Word, str]], reporter: Reporter) -> tuple[Binder, ...]:
    """Returns the parameters of a predicate; those that are no variables are reported."""
    parameters: list[Binder] = []
    for word, kind in pairs:
        name = word.key.removeprefix("?")
        if word.kind != "VARIABLE" or not is_name(name) or name in (parameter.variable for parameter in parameters):
            marked = f"?{name}" if is_name(name) and word.kind == "NAME" else ""
            reporter.add(
                "bad-predicate",
                word.span,
                f"`{word.text}` is no parameter: a parameter begins with a question mark, and has a name of its own.",
                expected=("?a",),
                hint=f"write {marked}" if marked else "",
                replacement=reporter.instead(word.span, marked),
            )
        else:
            parameters.append(Binder(name, kind))
    return tuple(parameters)


def _typed(items: Sequence[Item], reporter: Reporter, shape: str) -> list[tuple[Word, str]]:
    """Returns words with the type behind the next hyphen, `object` when there is none."""
    pairs: list[tuple[Word, str]] = []
    waiting: list[Word] = []
    position = 0
    while position < len(items):
        item = items[position]
        following = items[position + 1] if position + 1 < len(items) else None
        position += 1
        if isinstance(item, Word) and item.kind == "HYPHEN":
            position += 1
            if waiting and isinstance(following, Word) and following.kind == "NAME":
                pairs += [(word, following.key) for word in waiting]
                waiting = []
                continue
        elif isinstance(item, Word):
            waiting.append(item)
            continue
        reporter.add(
            "bad-objects",
            item.span,
            "Names belong here, and one type behind each hyphen.",
            expected=(shape,),
            hint=f"write {shape}",
        )
    return pairs + [(word, ROOT_CATEGORY) for word in waiting]


def _actions(sections: Sequence[Group], reporter: Reporter) -> tuple[DomainAction, ...]:
    found: dict[str, DomainAction] = {}
    for section in sections:
        word = section.items[1] if len(section.items) > 1 else None
        if not isinstance(word, Word) or word.kind != "NAME":
            reporter.add(
                "bad-section",
                section.items[0].span,
                "The name of the action belongs behind :action.",
                expected=("NAME",),
                hint="write (:action NAME :parameters (...) :precondition (...) :effect (...))",
            )
        elif word.text in found:
            reporter.add("repeated-section", word.span, f"The action `{word.text}` is there twice.")
        else:
            found[word.text] = DomainAction(word.text, form_text(section), span=section.span)
    return tuple(found.values())
