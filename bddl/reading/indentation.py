"""Which parentheses are wrong: by the words that must begin a form, or on lines whose indentation does not fit."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise

from bddl.reading.words import Word
from bddl.syntax.libero import REGION_ATTRIBUTES, ROWS, STYLE_ATTRIBUTES, read_number
from bddl.syntax.names import near_names
from bddl.syntax.profiles import FORM_SHAPES, Profile

# How many blanks may have stood behind a parenthesis that is lost.
_TRAILING_BLANKS = 3
# What defines something has one of these for its first form.
_TITLES = ("problem", "domain")


@dataclass(slots=True)
class Edits:
    """What to change in the words of a text.

    Attributes:
        dropped: Parentheses that are too many, by position.
        opened: Positions of words before which an opening parenthesis is missing.
        closed: Missing closing parentheses: behind which position, at which offset of the text.
    """

    dropped: dict[int, Word] = field(default_factory=dict)
    opened: list[int] = field(default_factory=list)
    closed: list[tuple[int, int]] = field(default_factory=list)


def edits_by_indentation(words: Sequence[Word], profile: Profile) -> Edits | None:
    """Returns the edits after which the parentheses match, or None when the indentation does not tell them.

    Args:
        words: The words and parentheses of a text whose parentheses do not match.
        profile: The dialect, which tells what a form may begin with.
    """
    heads = frozenset({*profile.words, *profile.absent_forms, "define", "problem", "domain", *_repeated_heads(words)})
    position_of = {id(word): position for position, word in enumerate(words)}
    edits = Edits()
    sections = {*profile.sections, *profile.ignored_sections}
    for slip in find_slips(words, heads, sections, ROWS if ":regions" in sections else ()):
        start = position_of[id(slip.words[0])]
        for _ in range(abs(slip.change)):
            if slip.change > 0:
                _close(words, start, slip, heads, profile, edits)
            else:
                _open(start, slip, heads, edits)
    return edits if _match(words, edits) else None


def _repeated_heads(words: Sequence[Word]) -> set[str]:
    """Returns the words that begin more than one form of the text: no slip, whatever they are."""
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
    words: Sequence[Word], start: int, slip: Imbalance, heads: Collection[str], profile: Profile, edits: Edits
) -> None:
    """Drops an opening parenthesis that begins no form, or adds a closing one."""
    line = slip.words
    for place, word in enumerate(line):
        following = words[start + place + 1] if start + place + 1 < len(words) else None
        if word.kind == "OPEN" and start + place not in edits.dropped and not _begins_form(following, heads):
            edits.dropped[start + place] = word
            return
    frames: list[Word] = []
    heads_of: list[Word | None] = []
    for position, word in enumerate(words[: start + len(line)]):
        if word.kind == "OPEN":
            within = position > start and bool(frames) and frames[-1].span.line == line[0].span.line
            if within and _holds_words_only(heads_of[-1], profile):
                # An atom is followed by another form on its own line: it ends before that.
                edits.closed.append((position - 1, words[position - 1].end))
                return
            frames.append(word)
            heads_of.append(None)
        elif word.kind == "CLOSE" and frames:
            frames.pop()
            heads_of.pop()
        elif frames and heads_of[-1] is None:
            heads_of[-1] = word
    last = start + len(line) - 1
    edits.closed.append((last, _place_behind(line[-1], frames)))


def _place_behind(last: Word, frames: Sequence[Word]) -> int:
    """Returns where the innermost open form should end: behind the last word, or on a line of its own that is empty."""
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


def _open(start: int, slip: Imbalance, heads: Collection[str], edits: Edits) -> None:
    """Adds an opening parenthesis before a word that begins a form, or drops a closing one."""
    line = slip.words
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
    """Decides whether a word begins a form without a parenthesis before it."""
    word = line[place]
    following = line[place + 1] if place + 1 < len(line) else None
    binds = word.kind == "VARIABLE" and following is not None and following.kind == "HYPHEN"
    # A number stands in parentheses of its own, and a section begins with one.
    begins = binds or word.kind == "SECTION" or word.key in heads or word.text.isdecimal()
    return begins and (place == 0 or line[place - 1].kind != "OPEN")


def _likelihood_of_surplus(line: Sequence[Word], place: int, heads: Collection[str]) -> int:
    """Returns a rank for a closing parenthesis; of those with the smallest rank, the last is too many."""
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


def _holds_words_only(head: Word | None, profile: Profile) -> bool:
    return head is not None and (head.kind == "VARIABLE" or head.key in profile.predicates)


def _match(words: Sequence[Word], edits: Edits) -> bool:
    depth = 0
    opened, closed = set(edits.opened), [position for position, _ in edits.closed]
    for position, word in enumerate(words):
        depth += position in opened
        if position not in edits.dropped:
            depth += (word.kind == "OPEN") - (word.kind == "CLOSE")
        depth -= closed.count(position)
        if depth < 0:
            return False
    return depth == 0 and bool(words)


def unopened_forms(words: Sequence[Word], profile: Profile) -> list[int]:
    """Returns the positions of the words before which an opening parenthesis is missing.

    Connectives, predicates with their names, sections, variables with a category and numbers behind `forn` begin
    forms. Only when there are as many of them without a parenthesis as there are closing ones too many, and all
    parentheses match with those put in, do they explain the text.

    Args:
        words: The words and parentheses of a text whose parentheses do not match.
        profile: The dialect.

    Returns:
        The positions in order, or nothing when such words do not explain the text.
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
    return found if len(found) == surplus and is_one_form(words, set(found)) else []


def _must_begin_form(words: Sequence[Word], position: int, profile: Profile) -> bool:
    """Decides whether a word must be the first of a form, to judge by what follows it."""
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
    """Decides whether a predicate is followed by as many names as it takes, and then by a closing parenthesis."""
    names = words[position + 1 : position + 1 + arity]
    end = position + 1 + arity
    plain = len(names) == arity and all(name.kind in ("NAME", "VARIABLE") for name in names)
    return plain and end < len(words) and words[end].kind == "CLOSE"


def is_one_form(words: Sequence[Word], opened: Collection[int] = ()) -> bool:
    """Decides whether words are one form and nothing else, with parentheses put in before some positions."""
    depth = 0
    for position, word in enumerate(words):
        depth += (position in opened) + (word.kind == "OPEN") - (word.kind == "CLOSE")
        if depth < 0 or (depth == 0 and position < len(words) - 1):
            return False
    return depth == 0 and bool(words) and words[-1].kind == "CLOSE"


_TAB_COLUMNS = 4
# A text of fewer lines says too little.
_LEAST_LINES = 4
# In a text of more lines the search would take too long.
_MOST_LINES = 50_000
# What it costs to suppose a parenthesis wrong, against one for each line that is indented wrongly.
_COST_OF_A_SLIP = 2
# A section stands directly inside the definition, whatever its indentation.
_COST_OF_A_DISPLACED_SECTION = 4
# How far the inner one of two forms that open on one line counts as indented behind the outer one.
_HALF_A_LEVEL = 2
# More slips than this are not told apart.
_MOST_SLIPS = 4


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
    """A line with the depth at its beginning, and the depth that its indentation speaks of."""

    words: Sequence[Word]
    depth: int
    level: int
    cost: int


def find_slips(
    words: Sequence[Word], heads: Collection[str], sections: Collection[str] = (), nested: Collection[str] = ()
) -> list[Imbalance]:
    """Returns the lines whose parentheses are wrong, or nothing when the indentation does not tell.

    Args:
        words: The words and parentheses of a text whose parentheses do not match.
        heads: The words that a form may begin with.
        sections: The words that open a section of a definition.
        nested: The words behind which a further form opens on the same line.
    """
    lines = _lines(words, heads, sections, nested)
    surplus = sum(_step(word) for word in words)
    if not _LEAST_LINES <= len(lines) <= _MOST_LINES or abs(surplus) > _MOST_SLIPS:
        return []
    # Line by line, for each excess of depth over level: the cost of the cheapest explanation, and the excess before.
    reach = range(-_MOST_SLIPS, _MOST_SLIPS + 1)
    first = lines[0].depth - lines[0].level
    costs = {excess: 0 if excess == first else len(words) for excess in reach}
    trail: list[dict[int, int]] = []
    for line in lines[1:]:
        best = {
            excess: min(reach, key=lambda before: (costs[before] + _COST_OF_A_SLIP * abs(before - excess), before))
            for excess in reach
        }
        costs = {
            excess: costs[before]
            + _COST_OF_A_SLIP * abs(before - excess)
            + line.cost * (line.depth - line.level != excess)
            for excess, before in best.items()
        }
        trail.append(best)
    # Behind the last line nothing may be open.
    last = min(reach, key=lambda excess: costs[excess] + _COST_OF_A_SLIP * abs(first + surplus - excess))
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
    """Returns the lines that hold something, with their depths and levels."""
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
                columns.append(column + _HALF_A_LEVEL)
        # A line of closing parentheses stands below the line that it closes.
        kinds = {word.kind for word in line}
        closing = "CLOSE" in kinds and kinds <= {"OPEN", "CLOSE"}
        cost = _COST_OF_A_DISPLACED_SECTION if displaced else 1
        lines.append(_Line(line, depth - closing, level, cost))
        depth += sum(_step(word) for word in line)
    return lines


def _opens_section(line: Sequence[Word], sections: Collection[str]) -> bool:
    return any(word.key in sections for word in line[:3] if word.kind == "SECTION")


def indent_of(word: Word) -> int:
    """Returns how far the line of a word is indented."""
    text = word.source.text
    start = text.rfind("\n", 0, word.offset) + 1
    return width_of_indent(text[start : word.offset])


def width_of_indent(line: str) -> int:
    """Returns how many columns of blanks a line begins with."""
    wide = line.expandtabs(_TAB_COLUMNS)
    return len(wide) - len(wide.lstrip())


def _step(word: Word) -> int:
    """Returns by how much a word changes the depth."""
    return (word.kind == "OPEN") - (word.kind == "CLOSE")
