"""Read a correct text in one pass: no grammar, no words with places, no messages.

Most texts are correct, and the reader with messages takes ten times as long. Whatever is unusual here, legal or not, is
left to that reader (`read_text`), so only it decides what is a mistake. The tables of the dialects decide for both, and
the places of what is read are computed when they are asked for.

Source: tests/bddl/test_direct.py compares both readers, places and warnings included.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Literal

from bddl.ast import (
    FORMS,
    QUANTIFIER_WORDS,
    Atom,
    Binder,
    Formula,
    Not,
    Place,
    Span,
    is_name,
    make_atom,
    make_placed,
)
from bddl.definitions import apply_rules
from bddl.diagnostics import Diagnostic, Reporter, Source
from bddl.dialects import FORM_SHAPES, ROOM, Profile, operand_count
from bddl.problem import ROOT_CATEGORY, WILDCARD, Problem, TypedObject, make_object

_COMMENT = re.compile(r";[^\n]*")
# Deeper forms are left to the reader without recursion.
_MOST_LEVELS = 60
# As in `bddl.formulas`.
_MOST_DIGITS = 9
_INSTANCE = re.compile(r".*_(\d+|\*)")


class _Unusual(Exception):
    """Raised where a text is not as most texts are."""


class _Form:
    """A parenthesised form: its words, the forms behind them, and the offsets of its first and behind its last sign."""

    __slots__ = ("end", "parts", "start", "words")

    def __init__(self, start: int, end: int, words: list[str], parts: list[_Form]) -> None:
        self.start = start
        self.end = end
        self.words = words
        self.parts = parts


# The parts of every form that has nothing but words.
_NO_PARTS: list[_Form] = []


def read_directly(
    text: str,
    wanted: Literal["formula", "problem", "domain", "any"],
    profile: Profile,
    objects: Mapping[str, str] | None,
) -> tuple[Formula | Problem, tuple[Diagnostic, ...]] | None:
    """Return what a text defines and the findings that the profile tolerates; None where the text is unusual.

    Arguments are those of `read_text`.
    """
    if not text.isascii() or profile.free_text:
        return None
    # Letter case and comments have no places of their own, so offsets stay.
    plain = _COMMENT.sub(_blank, text) if ";" in text else text
    try:
        form = _read_form(plain.lower() if profile.folds_case else plain)
        is_problem = form.words == ["define"]
        if wanted not in ("any", "problem" if is_problem else "formula"):
            return None
        if objects is not None and not all(map(is_name, objects)):
            return None
        reader = _Reader(plain, profile, objects)
        if not is_problem:
            return reader.formula(form, ""), ()
        problem = reader.problem(form)
    except _Unusual:
        return None
    if not reader.profile.rules:
        return problem, ()
    reporter = Reporter(text, profile.tolerated)
    apply_rules(problem, reader.profile, reporter, reader.used)
    if reporter:
        return None
    object.__setattr__(problem, "warnings", reporter.diagnostics)
    return problem, problem.warnings


def _blank(comment: re.Match[str]) -> str:
    return " " * len(comment.group())


def _read_form(text: str) -> _Form:
    """Return the one form of a text; words stand before the forms inside it."""
    first, *pieces = text.split("(")
    if first.strip() or not pieces:
        raise _Unusual
    offset = len(first)
    top: list[_Form] = []
    inner, opened = top, list[_Form]()
    # Each piece begins behind an opening parenthesis.
    for piece in pieces:
        run, closing, tail = piece.partition(")")
        if not closing:
            form = _Form(offset, 0, run.split(), [])
            inner.append(form)
            opened.append(form)
            inner = form.parts
            if len(opened) > _MOST_LEVELS:
                raise _Unusual
        else:
            end = offset + len(run) + 2
            inner.append(_Form(offset, end, run.split(), _NO_PARTS))
            if tail and not tail.isspace():
                *blanks, last = tail.split(")")
                for blank in blanks:
                    end += len(blank) + 1
                    # A word behind a form belongs nowhere.
                    if not opened or blank.strip():
                        raise _Unusual
                    opened.pop().end = end
                if last.strip():
                    raise _Unusual
                inner = opened[-1].parts if opened else top
        offset += 1 + len(piece)
    if opened or len(top) != 1:
        raise _Unusual
    return top[0]


class _Words:
    """The words between two offsets of a text, in which an offset is the number of a word."""

    __slots__ = ("_end", "_places", "_source", "_start")

    def __init__(self, source: Source, start: int, end: int) -> None:
        self._source = source
        self._start = start
        self._end = end
        self._places: tuple[Span, ...] | None = None

    def span(self, offset: int, length: int = 0) -> Span:
        """Return the place of a word."""
        if self._places is None:
            self._places = self._source.word_spans(self._start, self._end)
        return self._places[offset]


@lru_cache(maxsize=8192)
def _matches(pattern: re.Pattern[str], name: str, category: str = "") -> bool:
    """Decide whether a name is legal and, with a category, whether it is one of its instances."""
    if category:
        stem, _, number = name.rpartition("_")
        if stem != category or not (number.isdecimal() or number == WILDCARD[1:]):
            return False
    return pattern.fullmatch(name) is not None


class _Reader:
    """Reader of one text; `profile` has the predicates of the problem's domain once that is known."""

    def __init__(self, text: str, profile: Profile, objects: Mapping[str, str] | None) -> None:
        self._text = text
        self._source = Source(text)
        self.profile = profile
        # Declared objects must be among the scene's own, where there are such.
        self._scene = objects
        # The predicates that it has used so far.
        self.used: set[str] = set()
        self._known: dict[str, str] | None = None if objects is None else {**profile.builtin_objects, **objects}

    def _place(self, form: _Form) -> Place:
        return self._source, form.start, form.end

    def problem(self, form: _Form) -> Problem:
        """Return the problem of a form that begins with `define`; its rules are not yet checked."""
        profile = self.profile
        if profile.problem_type is not Problem:
            raise _Unusual
        sections = self._sections(form)
        # Names of problems keep their letter case in every dialect.
        title = sections["problem"]
        name = _one_name(title, self._text[title.start + 1 : title.end - 1].split())
        domain = _one_name(sections[":domain"], sections[":domain"].words)
        if profile.domains:
            if domain not in profile.domains:
                raise _Unusual
            self.profile = profile.for_domain(profile.domains[domain])
        if self._known is None:
            self._known = dict(profile.builtin_objects)
        listed = self._objects(sections[":objects"]) if ":objects" in sections else ()
        init = sections.get(":init")
        goal = sections[":goal"]
        if len(goal.parts) != 1 or len(goal.words) > 1 or (init is not None and len(init.words) > 1):
            raise _Unusual
        return make_placed(  # type: ignore[no-any-return]
            Problem,
            self._place(form),
            name=name,
            domain=domain,
            objects=listed,
            init=() if init is None else tuple([self._literal(part) for part in init.parts]),
            goal=self.formula(goal.parts[0], ":goal"),
            warnings=(),
        )

    def _sections(self, form: _Form) -> dict[str, _Form]:
        profile, found = self.profile, dict[str, _Form]()
        for part in form.parts:
            head = part.words[0].lower() if part.words else ""
            if head in found or (head != "problem" and head not in profile.sections):
                if head not in profile.ignored_sections:
                    raise _Unusual
            else:
                found[head] = part
        for name in ("problem", ":domain", ":goal", *profile.required_sections):
            if name not in found:
                raise _Unusual
        return found

    def _objects(self, section: _Form) -> tuple[TypedObject, ...]:
        """Return the declared objects; formulas may name them from here on."""
        if section.parts:
            raise _Unusual
        words, scene = section.words, None if self._scene is None else self._known
        synsets, pattern = "instances" in self.profile.rules, self.profile.object_name
        places = _Words(self._source, section.start + 1, section.end - 1)
        objects: list[TypedObject] = []
        known: dict[str, str] = {}
        categories: set[str] = set()
        start, hyphens = 1, [at for at, word in enumerate(words) if word == "-"]
        for hyphen in hyphens:
            category = words[hyphen + 1] if hyphen + 1 < len(words) else ""
            if hyphen == start or not self._is_category(category) or (synsets and category in categories):
                raise _Unusual
            categories.add(category)
            for at in range(start, hyphen):
                name = words[at]
                if name in known or not _matches(pattern, name, category if synsets else ""):
                    raise _Unusual
                known[name] = category
                objects.append(make_object(name, category, (places, at, at)))
            start = hyphen + 2
        # Names without a category are left to the other reader.
        if start < len(words) or (scene is not None and not known.keys() <= scene.keys()):
            raise _Unusual
        self._known = {**(self.profile.builtin_objects if scene is None else scene), **known}
        return tuple(objects)

    def _is_category(self, word: str) -> bool:
        pattern = self.profile.category_name or self.profile.object_name
        return _matches(pattern, word)

    def _literal(self, form: _Form) -> Formula:
        if not form.parts:
            return self._atom(form, ":init", ())
        words = form.words
        if len(words) == 1 and words[0].lower() == "not" and len(form.parts) == 1 and "not" in self.profile.forms:
            body = self._atom(form.parts[0], ":init", ())
            return make_placed(Not, self._place(form), body=body)  # type: ignore[no-any-return]
        raise _Unusual

    def formula(self, form: _Form, section: str, bound: tuple[str, ...] = ()) -> Formula:
        """Return the formula of a form inside the scope of some variables."""
        words, parts = form.words, form.parts
        word = words[0].lower() if words else ""
        if word not in self.profile.forms:
            return self._atom(form, section, bound)
        if len(words) > 1:
            raise _Unusual
        place = self._place(form)
        if word in QUANTIFIER_WORDS:
            return self._quantifier(word, form, section, bound)
        wanted = operand_count(word)
        if wanted is not None and len(parts) != wanted:
            raise _Unusual
        operands = tuple([self.formula(part, section, bound) for part in parts])
        kind = FORMS[word]
        if wanted is None:
            return make_placed(kind, place, parts=operands)  # type: ignore[no-any-return]
        if kind is Not:
            return make_placed(kind, place, body=operands[0])  # type: ignore[no-any-return]
        return make_placed(kind, place, left=operands[0], right=operands[1])  # type: ignore[no-any-return]

    def _quantifier(self, word: str, form: _Form, section: str, bound: tuple[str, ...]) -> Formula:
        parts, shape = list(form.parts), FORM_SHAPES[word]
        fields: dict[str, object] = {}
        if "(N)" in shape:
            digits = parts.pop(0).words if parts and not parts[0].parts else []
            if len(digits) != 1 or not digits[0].isdecimal() or len(digits[0]) > _MOST_DIGITS:
                raise _Unusual
            fields["count"] = int(digits[0])
        count = shape.count("CATEGORY")
        if len(parts) != count + 1:
            raise _Unusual
        binders = [self._binder(part) for part in parts[:count]]
        for prefix, binder in zip(("", "other_"), binders, strict=False):
            fields[prefix + "variable"], fields[prefix + "category"] = binder
        body = self.formula(parts[count], section, (*bound, *[binder.variable for binder in binders]))
        return make_placed(FORMS[word], self._place(form), body=body, **fields)  # type: ignore[no-any-return]

    def _binder(self, form: _Form) -> Binder:
        words, profile = form.words, self.profile
        if form.parts or len(words) != 3 or words[1] != "-" or words[0][0] != "?":
            raise _Unusual
        variable, category = words[0][1:], words[2]
        if not _matches(profile.object_name, variable) or not self._is_category(category):
            raise _Unusual
        known = self._known
        root = category == ROOT_CATEGORY and not profile.folds_case
        if known is not None and category not in known.values() and not root:
            raise _Unusual
        return Binder(variable, category)

    def _atom(self, form: _Form, section: str, bound: tuple[str, ...]) -> Atom:
        words = form.words
        if not words or form.parts:
            raise _Unusual
        predicate, profile = words[0], self.profile
        spec = profile.predicates.get(predicate)
        if spec is None:
            predicate = predicate.lower()
            spec = profile.predicates.get(predicate)
        args, place = tuple(words[1:]), (self._source, form.start, form.end)
        if spec is None or len(args) != len(spec.parameters):
            raise _Unusual
        if spec.section and section not in ("", spec.section) and "sections" in profile.rules:
            raise _Unusual
        self.used.add(predicate)
        known, rooms = self._known or {}, spec.parameters.count(ROOM)
        # The most frequent cases: plain names of declared objects, the last one of a room.
        plain = args[:-1] if rooms == 1 and spec.parameters[-1] == ROOM and args[-1] in profile.rooms else args
        if not rooms or plain is not args:
            for word in plain:
                if word not in known:
                    break
            else:
                return make_atom(predicate, args, place)
        names = [self._argument(word, section, bound, spec.parameters[at] == ROOM) for at, word in enumerate(args)]
        return make_atom(predicate, tuple(names), place)

    def _argument(self, word: str, section: str, bound: tuple[str, ...], is_room: bool) -> str:
        """Return the name in a word."""
        profile, known, marked = self.profile, self._known, word[0] == "?"
        name = word[1:] if marked else word
        if name in bound:
            return name
        is_known = known is not None and name in known
        if not is_known and not _matches(profile.object_name, name):
            raise _Unusual
        if marked and (section == ":init" or not profile.free_marks or not (is_known or _INSTANCE.fullmatch(name))):
            raise _Unusual
        legal = (not profile.rooms or name in profile.rooms) if is_room else (is_known or known is None)
        if not legal:
            raise _Unusual
        return name


def _one_name(section: _Form, words: Sequence[str]) -> str:
    if section.parts or len(words) != 2 or not is_name(words[1]):
        raise _Unusual
    return words[1]
