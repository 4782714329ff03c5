"""From the form `(define (domain ...) ...)` to a domain."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

from bddl.reading.sections import UNNAMED, SectionNames, collect_sections, read_name
from bddl.reading.words import Group, Item, Word, form_text
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.names import near_names
from bddl.syntax.problem import ROOT_CATEGORY, Domain, DomainAction, DomainPredicate, TypedObject
from bddl.syntax.tree import RESERVED_WORDS, Binder, is_name

# What a domain may ask of those who read it; only the names are known here.
REQUIREMENTS = (":strips", ":negative-preconditions", ":typing", ":adl")
_SECTIONS = ("domain", ":requirements", ":types", ":predicates", ":action")


def read_domain(group: Group, reporter: Reporter) -> Domain:
    """Returns the domain that a form defines; what is wrong in it is reported and left out.

    Args:
        group: The form.
        reporter: Receives the diagnostics.

    Source: the reference implementation, `parse_domain`, which reads the name of every action as `:parameters`.
    """
    names = SectionNames("language", "domain", _SECTIONS, ("domain", ":predicates"), repeatable=(":action",))
    draft = _DomainDraft(reporter, [])
    for name, sections in collect_sections(group, names, reporter).items():
        for section in sections:
            _READERS[name](draft, section)
    actions = tuple(draft.actions)
    return Domain(draft.name, draft.requirements, draft.types, draft.predicates, actions, span=group.span)


@dataclass(slots=True)
class _DomainDraft:
    reporter: Reporter
    actions: list[DomainAction]
    name: str = UNNAMED
    requirements: tuple[str, ...] = ()
    types: tuple[TypedObject, ...] = ()
    predicates: tuple[DomainPredicate, ...] = ()


_SectionReader: TypeAlias = Callable[[_DomainDraft, Group], None]


def _read_title(draft: _DomainDraft, section: Group) -> None:
    word = read_name(section, draft.reporter)
    if word is not None:
        draft.name = word.text


def _read_requirements(draft: _DomainDraft, section: Group) -> None:
    for item in section.items[1:]:
        key = item.key if isinstance(item, Word) else ""
        if key not in REQUIREMENTS:
            near = near_names(key, REQUIREMENTS)
            draft.reporter.add(
                "unknown-requirement",
                item.span,
                f"There is no requirement `{draft.reporter.quote(item.span)}`.",
                expected=near or REQUIREMENTS,
                hint=f"did you mean {near[0]}?" if near else f"the requirements are: {', '.join(REQUIREMENTS)}",
            )
    words = [item.key for item in section.items[1:] if isinstance(item, Word)]
    draft.requirements = (*draft.requirements, *words)


def _read_types(draft: _DomainDraft, section: Group) -> None:
    pairs = _typed(section.items[1:], draft.reporter, "TYPE ... - SUPERTYPE")
    draft.types = tuple(TypedObject(word.key, kind, span=word.span) for word, kind in pairs if is_name(word.key))


def _read_predicates(draft: _DomainDraft, section: Group) -> None:
    found: dict[str, DomainPredicate] = {}
    for item in section.items[1:]:
        head = item.head if isinstance(item, Group) else None
        if not isinstance(item, Group) or head is None or head.kind != "NAME" or head.key in RESERVED_WORDS:
            draft.reporter.add(
                "bad-predicate",
                item.span,
                "The declaration of a predicate belongs here.",
                expected=("(NAME ?a ?b)",),
                hint="write the predicate with its parameters, such as (ontop ?item ?support)",
            )
            continue
        if head.key in found:
            draft.reporter.add(
                "repeated-predicate",
                head.span,
                f"The predicate `{head.key}` is declared twice.",
                hint="declare it once",
                related=found[head.key].span,
            )
            continue
        pairs = _typed(item.items[1:], draft.reporter, "?a ?b - TYPE")
        parameters = _parameters(pairs, draft.reporter)
        found[head.key] = DomainPredicate(head.key, parameters, span=item.span)
    draft.predicates = tuple(found.values())


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


def _read_action(draft: _DomainDraft, section: Group) -> None:
    word = section.items[1] if len(section.items) > 1 else None
    if not isinstance(word, Word) or word.kind != "NAME":
        draft.reporter.add(
            "bad-section",
            section.items[0].span,
            "The name of the action belongs behind :action.",
            expected=("NAME",),
            hint="write (:action NAME :parameters (...) :precondition (...) :effect (...))",
        )
        return
    if word.text in (action.name for action in draft.actions):
        draft.reporter.add("repeated-section", word.span, f"The action `{word.text}` is there twice.")
        return
    draft.actions.append(DomainAction(word.text, form_text(section), span=section.span))


_READERS: Mapping[str, _SectionReader] = MappingProxyType(
    {
        "domain": _read_title,
        ":requirements": _read_requirements,
        ":types": _read_types,
        ":predicates": _read_predicates,
        ":action": _read_action,
    }
)
