"""Where the parentheses of a text stop agreeing with its indentation.

A text is indented by people and programs who know how deep they are. So a missing or surplus parenthesis shows: up to
its line, indentation and depth agree, and behind it they differ by one. What is sought is the cheapest explanation of
all lines together, which a single badly indented line cannot upset.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import groupby

from bddl.reading.words.forest import Word

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
