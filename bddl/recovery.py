"""Recover from unmatched parentheses: by words that must begin a form, by indentation, or by counting."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import accumulate, groupby, pairwise

from bddl.ast import Span
from bddl.diagnostics import Code, Reporter
from bddl.dialects import FORM_SHAPES, Profile, inner_forms, near_names
from bddl.lexer import Word
from bddl.problem import REGION_ATTRIBUTES, ROWS, STYLE_ATTRIBUTES, read_number


@dataclass(slots=True)
class _Edits:
    """Changes to the words of a text after which its parentheses match, by positions of words.

    Attributes:
        dropped: Surplus parentheses.
        opened: Words before which an opening parenthesis is missing.
        closed: Missing closing parentheses: behind which word, at which offset of the text, and how many.
    """

    dropped: dict[int, Word] = field(default_factory=dict)
    opened: list[int] = field(default_factory=list)
    closed: list[tuple[int, int, int]] = field(default_factory=list)

    def depths(self, words: Sequence[Word]) -> Iterator[int]:
        """Yield the depth behind each word."""
        opened, closed = set(self.opened), Counter[int]()
        for behind, _, count in self.closed:
            closed[behind] += count
        depth = 0
        for position, word in enumerate(words):
            depth += (position in opened) - closed[position] + (position not in self.dropped and _step(word))
            yield depth


def recover_parentheses(words: list[Word], profile: Profile, reporter: Reporter) -> list[Word]:
    """Report unmatched parentheses and return the words with matching ones.

    Three methods are tried in turn. Words that must begin a form get their missing opening parentheses. Indentation
    tells which line is wrong, and the parentheses of that line are corrected. Otherwise a parenthesis that closes
    nothing is dropped, and a missing one is inserted where the text shows that it belongs. An atom or a full `not` ends
    before the next opening parenthesis. A section ends before the next section, and any other form at the end.
    """
    bare = _unopened_forms(words, profile)
    edits = _Edits(opened=bare) if bare else _edits_by_indentation(words, profile)
    counted = edits is None
    if edits is None:
        edits = _edits_by_counting(words, profile)
    fixed, gaps = _apply(words, edits)

    def report(
        code: Code, place: Span, message: str, hint: str, expected: tuple[str, ...] = (), related: Span | None = None
    ) -> None:
        reporter.add(code, place, message, expected=expected, hint=hint, related=related, whole=True)

    dropped = list(edits.dropped.values())
    if counted and dropped:
        message = "This closing parenthesis closes nothing."
        if len(dropped) > 1:
            message = f"From here on, {len(dropped)} closing parentheses close nothing."
        advice = "remove it" if len(dropped) == 1 else "remove them"
        report("extra-parenthesis", dropped[0].span, message, advice, ("end of text",))
    for word in () if counted else dropped:
        message = "This closing parenthesis is one too many: what follows is indented as if it were not there."
        if word.kind == "OPEN":
            message = "This opening parenthesis begins no form."
        report("extra-parenthesis", word.span, message, "remove it")
    for place, starts in gaps:
        first, count = min((word.span for word in starts), key=lambda span: span.offset), len(starts)
        where = f"opened at line {first.line}, column {first.column}"
        message = f"A closing parenthesis is missing: the one {where} is never closed."
        if count > 1:
            message = f"{count} closing parentheses are missing: {count} forms, the first {where}, are never closed."
        report("missing-parenthesis", place, message, f"add {')' * min(count, 20)} here", (")",), related=first)
    for word in (words[position] for position in edits.opened):
        message = f"An opening parenthesis is missing before `{word.text}`."
        report("missing-parenthesis", word.span, message, f"write ({word.text}", ("(",))
    return fixed


def _apply(words: list[Word], edits: _Edits) -> tuple[list[Word], list[tuple[Span, list[Word]]]]:
    """Return the words after some edits, and each place of missing parentheses with those that they would close."""
    fixed: list[Word] = []
    frames: list[Word] = []
    gaps: list[tuple[Span, list[Word]]] = []
    opened = set(edits.opened)
    closed: defaultdict[int, list[tuple[int, int]]] = defaultdict(list)
    for behind, offset, count in edits.closed:
        closed[behind].append((offset, count))
    for position, word in enumerate(words):
        if position in opened:
            fixed.append(Word("OPEN", "(", word.offset, word.source, invented=True))
            frames.append(fixed[-1])
        if position not in edits.dropped:
            fixed.append(word)
            if word.kind == "OPEN":
                frames.append(word)
            elif word.kind == "CLOSE":
                frames.pop()
        for offset, count in closed.get(position, ()):
            closing = Word("CLOSE", ")", offset, word.source, invented=True)
            fixed += [closing] * count
            gaps.append((closing.span, [frames.pop() for _ in range(count)]))
    return fixed, gaps


def _edits_by_counting(words: list[Word], profile: Profile) -> _Edits:
    edits = _Edits(dropped={position: words[position] for position in _unmatched_closings(words)})
    kept = [position for position in range(len(words)) if position not in edits.dropped]
    spare = _spare_closings([words[position] for position in kept])
    added = 0
    frames: list[_OpenForm] = []
    for place, position in enumerate(kept):
        word = words[position]
        if word.kind == "OPEN":
            following = words[kept[place + 1]] if place + 1 < len(kept) else None
            count = min(spare[place] - added, _frames_ended(frames, following, profile))
            if count > 0:
                edits.closed.append((kept[place - 1], words[kept[place - 1]].end, count))
                del frames[-count:]
                added += count
            if frames:
                frames[-1].forms += 1
            frames.append(_OpenForm())
        elif word.kind == "CLOSE":
            frames.pop()
        elif frames:
            frames[-1].take(word)
    if frames:
        # The end of a Markdown code fence is no part of what it encloses.
        fenced = len(kept) > 1 and words[kept[-1]].text.startswith(("```", "~~~"))
        last = kept[-2] if fenced else kept[-1]
        edits.closed.append((last, words[last].end, len(frames)))
    return edits


def _unmatched_closings(words: list[Word]) -> list[int]:
    depth = 0
    extra: list[int] = []
    ends: list[int] = []
    for position, word in enumerate(words):
        if word.kind == "CLOSE" and depth == 0:
            extra.append(position)
            continue
        depth += _step(word)
        if word.kind == "CLOSE" and depth == 0:
            ends.append(position)
    takes_more = len(words) > 1 and words[1].key in ("and", "or", "define")
    if takes_more and len(extra) == 1 and len(ends) > 1 and depth == 0 and extra[0] == len(words) - 1:
        # In `(and (a)) (b))` the surplus one is not the last but the one that ended the formula too early.
        return [ends[0]]
    return extra


def _spare_closings(words: list[Word]) -> list[int]:
    """Return for each word how many closing parentheses may be added before it, so that each behind it has a match."""
    depths = accumulate(map(_step, words))
    return list(accumulate(reversed(list(depths)), min))[::-1]


def _frames_ended(frames: list[_OpenForm], following: Word | None, profile: Profile) -> int:
    """Return how many open forms must have ended before a parenthesis that opens here; never the outermost."""
    if following is not None and following.kind == "SECTION":
        return max(0, len(frames) - 1)
    count = 0
    while count < len(frames) - 1 and frames[-1 - count].is_complete(profile):
        count += 1
    return count


@dataclass(slots=True)
class _OpenForm:
    head: Word | None = None
    words: int = 0
    forms: int = 0

    def take(self, word: Word) -> None:
        """Count a word; the first item of the form is its head when it is a word."""
        if self.head is None and self.forms == 0:
            self.head = word
        else:
            self.words += 1

    def is_complete(self, profile: Profile) -> bool:
        """Decide whether no further form can belong inside this one."""
        if self.head is None:
            return False
        if self.head.kind == "VARIABLE":
            return True
        if self.head.key in FORM_SHAPES:
            return self.forms >= inner_forms(self.head.key)
        return self.words > 0 and self.head.kind == "NAME" and not _may_hold_forms(self.head, profile)


def _may_hold_forms(head: Word, profile: Profile) -> bool:
    """Decide whether a form with this head has forms inside: a connective, a misspelt one, or a problem."""
    if head.key in profile.predicates:
        return False
    legal = (*profile.forms, *profile.absent_forms, "define")
    return head.key in legal or bool(near_names(head.text, legal))


# Limit of the blanks behind a lost parenthesis.
_TRAILING_BLANKS = 3
# The first form of a definition is one of these.
_TITLES = ("problem", "domain")


def _edits_by_indentation(words: Sequence[Word], profile: Profile) -> _Edits | None:
    """Return the edits after which the parentheses match, or None when the indentation does not determine them."""
    heads = frozenset({*profile.words, *profile.absent_forms, "define", "problem", "domain", *_repeated_heads(words)})
    position_of = {id(word): position for position, word in enumerate(words)}
    edits = _Edits()
    sections = {*profile.sections, *profile.ignored_sections}
    for imbalance in find_imbalances(words, heads, sections, ROWS if ":regions" in sections else ()):
        start = position_of[id(imbalance.words[0])]
        for _ in range(abs(imbalance.change)):
            if imbalance.change > 0:
                _close(words, start, imbalance, heads, profile, edits)
            else:
                _open(start, imbalance, heads, edits)
    depths = list(edits.depths(words))
    return edits if depths[-1] == 0 and min(depths) >= 0 else None


def _repeated_heads(words: Sequence[Word]) -> set[str]:
    """Return the words that begin more than one form of the text: these are not misspelt, whatever they are."""
    heads = Counter(
        word.key for opening, word in pairwise(words) if opening.kind == "OPEN" and word.kind in ("NAME", "SECTION")
    )
    # A region or a part of the scene is named once, and its attributes follow.
    titles = {
        words[position].key
        for position in range(len(words) - 2)
        if words[position].kind == "NAME"
        and words[position + 1].kind == "OPEN"
        and words[position + 2].key in (*REGION_ATTRIBUTES, *STYLE_ATTRIBUTES)
    }
    return titles | {head for head, count in heads.items() if count > 1}


def _close(
    words: Sequence[Word], start: int, imbalance: Imbalance, heads: Collection[str], profile: Profile, edits: _Edits
) -> None:
    line = imbalance.words
    for place, word in enumerate(line):
        following = words[start + place + 1] if start + place + 1 < len(words) else None
        if word.kind == "OPEN" and start + place not in edits.dropped and not _begins_form(following, heads):
            edits.dropped[start + place] = word
            return
    frames: list[Word] = []
    heads_of: list[Word | None] = []
    for position, word in enumerate(words[: start + len(line)]):
        if word.kind == "OPEN":
            head = heads_of[-1] if heads_of else None
            within = position > start and bool(frames) and frames[-1].span.line == line[0].span.line
            if within and head is not None and (head.kind == "VARIABLE" or head.key in profile.predicates):
                # An atom is followed by another form on its own line: it ends before that.
                edits.closed.append((position - 1, words[position - 1].end, 1))
                return
            frames.append(word)
            heads_of.append(None)
        elif word.kind == "CLOSE" and frames:
            frames.pop()
            heads_of.pop()
        elif frames and heads_of[-1] is None:
            heads_of[-1] = word
    last = start + len(line) - 1
    edits.closed.append((last, _place_behind(line[-1], frames), 1))


def _place_behind(last: Word, frames: Sequence[Word]) -> int:
    """Return where the innermost open form should end: behind the last word, or on a line of its own that is empty."""
    text = last.source.text
    if not frames or frames[-1].span.line == last.span.line:
        return last.end
    wanted = indent_of(frames[-1])
    start = text.find("\n", last.end) + 1
    while start:
        end = text.find("\n", start)
        line = text[start:] if end < 0 else text[start:end]
        if line.strip():
            break
        # Blanks behind the parenthesis stay when it is lost.
        if wanted <= width_of_indent(line + ".") <= wanted + _TRAILING_BLANKS:
            return start + min(len(line), wanted)
        start = end + 1
    return last.end


def _open(start: int, imbalance: Imbalance, heads: Collection[str], edits: _Edits) -> None:
    line = imbalance.words
    for place in range(len(line)):
        if start + place in edits.opened or not _lacks_opening(line, place, heads):
            continue
        # In `()open x)` nothing is missing: the form is closed before it begins.
        if place > 1 and line[place - 1].kind == "CLOSE" and line[place - 2].kind == "OPEN":
            edits.dropped[start + place - 1] = line[place - 1]
        else:
            edits.opened.append(start + place)
        return
    closing = [place for place, word in enumerate(line) if word.kind == "CLOSE" and start + place not in edits.dropped]
    if closing:
        place = min(closing, key=lambda place: (_likelihood_of_surplus(line, place, heads), -place))
        edits.dropped[start + place] = line[place]
    else:
        edits.opened.append(start)


def _lacks_opening(line: Sequence[Word], place: int, heads: Collection[str]) -> bool:
    word = line[place]
    following = line[place + 1] if place + 1 < len(line) else None
    binds = word.kind == "VARIABLE" and following is not None and following.kind == "HYPHEN"
    # A number stands in parentheses of its own, and a section begins with one.
    begins = binds or word.kind == "SECTION" or word.key in heads or word.text.isdecimal()
    return begins and (place == 0 or line[place - 1].kind != "OPEN")


def _likelihood_of_surplus(line: Sequence[Word], place: int, heads: Collection[str]) -> int:
    """Return a rank for a closing parenthesis; of those with the smallest rank, the last is too many."""
    following = line[place + 1] if place + 1 < len(line) else None
    words_behind = following is not None and following.kind not in ("OPEN", "CLOSE")
    only_head_before = place > 0 and line[place - 1].key in heads
    if words_behind or only_head_before:
        return 0
    # Where it opens its line, forms that follow on the line stand behind it by mistake.
    return 1 if place == 0 and following is not None else 2


def _begins_form(word: Word | None, heads: Collection[str]) -> bool:
    if word is None or word.kind in ("OPEN", "CLOSE", "HYPHEN"):
        return False
    begins = word.kind in ("SECTION", "VARIABLE") or word.key in heads or read_number(word.text) is not None
    return begins or bool(near_names(word.text, heads))


def _unopened_forms(words: Sequence[Word], profile: Profile) -> list[int]:
    """Return the positions of the words before which an opening parenthesis is missing.

    Connectives, predicates with their names, sections, variables with a category and numbers behind `forn` begin forms.
    They explain the text under two conditions. Those without a parenthesis are as many as the surplus closing ones, and
    all parentheses match once theirs are inserted.
    """
    surplus = sum((word.kind == "CLOSE") - (word.kind == "OPEN") for word in words)
    if surplus <= 0:
        return []
    found: list[int] = []
    for position, word in enumerate(words):
        opened = position > 0 and words[position - 1].kind == "OPEN"
        if not opened and word.kind not in ("OPEN", "CLOSE", "HYPHEN") and _must_begin_form(words, position, profile):
            found.append(position)
            if len(found) > surplus:
                return []
    depths = list(_Edits(opened=found).depths(words))
    # All words are one form.
    matched = depths[-1] == 0 and min(depths[:-1], default=0) > 0 and words[-1].kind == "CLOSE"
    return found if len(found) == surplus and matched else []


def _must_begin_form(words: Sequence[Word], position: int, profile: Profile) -> bool:
    """Decide by the words that follow whether a word must be the first of a form."""
    word = words[position]
    following = words[position + 1] if position + 1 < len(words) else None
    if following is None:
        return False
    if word.kind == "SECTION":
        attributes = REGION_ATTRIBUTES if ":regions" in profile.sections else ()
        return word.key in (*profile.sections, *profile.ignored_sections, *attributes)
    before = words[position - 1] if position else None
    if word.kind == "VARIABLE":
        return following.kind == "HYPHEN"
    if word.key in profile.predicates:
        return _has_its_names(words, position, profile.predicates[word.key].arity)
    if before is not None and "(N)" in FORM_SHAPES.get(before.key, ""):
        return word.text.isdecimal() and following.kind == "CLOSE"
    if word.key in profile.forms:
        bare = following.kind != "OPEN" and _must_begin_form(words, position + 1, profile)
        return following.kind == "OPEN" or bare or (following.kind == "CLOSE" and word.key in ("and", "or"))
    if word.key in _TITLES:
        return before is not None and before.key == "define"
    return word.key == "define" and position == 0


def _has_its_names(words: Sequence[Word], position: int, arity: int) -> bool:
    names = words[position + 1 : position + 1 + arity]
    end = position + 1 + arity
    plain = len(names) == arity and all(name.kind in ("NAME", "VARIABLE") for name in names)
    return plain and end < len(words) and words[end].kind == "CLOSE"


_TAB_COLUMNS = 4
# Fewer lines are too little evidence.
_MIN_LINES = 4
# With more lines the search would take too long.
_MAX_LINES = 50_000
# Cost of a wrong parenthesis; a wrongly indented line costs 1.
_IMBALANCE_COST = 2
# A section stands directly inside the definition, whatever its indentation.
_DISPLACED_SECTION_COST = 4
# Assumed indentation [columns] of the inner of two forms that open on one line, behind the outer one.
_HALF_LEVEL = 2
# Larger imbalances are not distinguished.
_MAX_IMBALANCE = 4


@dataclass(frozen=True, slots=True)
class Imbalance:
    """Parentheses that are wrong on one line.

    Attributes:
        words: The words and parentheses of the line.
        change: How much too deep the text is behind them: closing parentheses missing, or surplus if negative.
    """

    words: Sequence[Word]
    change: int


@dataclass(frozen=True, slots=True)
class _Line:
    """A line with the depth at its beginning, and the depth (`level`) that its indentation indicates."""

    words: Sequence[Word]
    depth: int
    level: int
    cost: int


def find_imbalances(
    words: Sequence[Word], heads: Collection[str], sections: Collection[str] = (), nested: Collection[str] = ()
) -> list[Imbalance]:
    """Return the lines whose parentheses are wrong, or nothing when the indentation does not tell."""
    lines = _lines(words, heads, sections, nested)
    surplus = sum(_step(word) for word in words)
    if not _MIN_LINES <= len(lines) <= _MAX_LINES or abs(surplus) > _MAX_IMBALANCE:
        return []
    # Line by line, for each excess of depth over level: the cost of the cheapest explanation, and the excess before.
    reach = range(-_MAX_IMBALANCE, _MAX_IMBALANCE + 1)
    first = lines[0].depth - lines[0].level
    costs = {excess: 0 if excess == first else len(words) for excess in reach}
    trail: list[dict[int, int]] = []
    for line in lines[1:]:
        best = {
            excess: min(reach, key=lambda before: (costs[before] + _IMBALANCE_COST * abs(before - excess), before))
            for excess in reach
        }
        costs = {
            excess: costs[before]
            + _IMBALANCE_COST * abs(before - excess)
            + line.cost * (line.depth - line.level != excess)
            for excess, before in best.items()
        }
        trail.append(best)
    # Behind the last line nothing may be open.
    last = min(reach, key=lambda excess: costs[excess] + _IMBALANCE_COST * abs(first + surplus - excess))
    excesses = [first + surplus, last]
    for best in reversed(trail):
        excesses.append(best[excesses[-1]])
    excesses.reverse()
    return [
        Imbalance(line.words, after - before)
        for line, before, after in zip(lines, excesses[:-1], excesses[1:], strict=True)
        if before != after
    ]


def _lines(
    words: Sequence[Word], heads: Collection[str], sections: Collection[str], nested: Collection[str]
) -> list[_Line]:
    lines: list[_Line] = []
    depth = 0
    columns: list[int] = []
    grouped = [list(group) for _, group in groupby(words, key=lambda word: word.span.line)]
    defines = any(word.key == "define" for word in grouped[0][:2]) if grouped else False
    for number, line in enumerate(grouped):
        column = indent_of(line[0])
        displaced = defines and number > 0 and _opens_section(line, sections)
        if displaced:
            del columns[1:]
        level = 1 if displaced else bisect_left(columns, column)
        # Names in a list are often indented carelessly, and nothing stands inside them.
        if displaced or line[0].kind in ("OPEN", "CLOSE", "SECTION") or line[0].key in heads:
            columns[level:] = [column]
            following = grouped[number + 1] if number + 1 < len(grouped) else []
            if any(word.key in nested for word in line[:3]) and [word.kind for word in following] != ["OPEN"]:
                columns.append(column + _HALF_LEVEL)
        # A line of closing parentheses stands below the line that it closes.
        kinds = {word.kind for word in line}
        closing = "CLOSE" in kinds and kinds <= {"OPEN", "CLOSE"}
        cost = _DISPLACED_SECTION_COST if displaced else 1
        lines.append(_Line(line, depth - closing, level, cost))
        depth += sum(_step(word) for word in line)
    return lines


def _opens_section(line: Sequence[Word], sections: Collection[str]) -> bool:
    return any(word.key in sections for word in line[:3] if word.kind == "SECTION")


def indent_of(word: Word) -> int:
    """Return how far the line of a word is indented."""
    text = word.source.text
    start = text.rfind("\n", 0, word.offset) + 1
    return width_of_indent(text[start : word.offset])


def width_of_indent(line: str) -> int:
    """Return how many columns of blanks a line begins with."""
    wide = line.expandtabs(_TAB_COLUMNS)
    return len(wide) - len(wide.lstrip())


def _step(word: Word) -> int:
    return (word.kind == "OPEN") - (word.kind == "CLOSE")
