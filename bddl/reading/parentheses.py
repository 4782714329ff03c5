"""Where parentheses are missing or too many, and the words as they would read with that put right."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from typing import TypeAlias

from bddl.reading.indentation import Edits, edits_by_indentation, unopened_forms
from bddl.reading.words import Word
from bddl.syntax.codes import Code
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.names import near_names
from bddl.syntax.profiles import FORM_SHAPES, Profile, inner_forms
from bddl.syntax.tree import Span

# A place where parentheses are missing, with the opening parentheses that they would close.
_Gap: TypeAlias = tuple[Span, list[Word]]


def repair(words: list[Word], profile: Profile, reporter: Reporter) -> list[Word]:
    """Reports unmatched parentheses and returns the words with matching ones.

    Where words that begin a form lack their opening parentheses, these are put in. Where the indentation tells which
    line is wrong, the parentheses of that line are put right. Otherwise one that closes nothing is dropped, and a
    missing one is put where the text shows that it belongs: an atom or a full `not` ends before the next opening
    parenthesis, a section before the next section; failing that, at the end.

    Args:
        words: The words of a text whose parentheses do not match.
        profile: The dialect, which tells atoms from connectives.
        reporter: Receives the diagnostics.

    Returns:
        The words, some parentheses dropped and some invented; their parentheses match.
    """
    bare = unopened_forms(words, profile)
    edits = Edits(opened=bare) if bare else edits_by_indentation(words, profile)
    openings: list[Word] = []
    surplus: list[Word] = []
    dropped: list[Word] = []
    if edits is not None:
        surplus = list(edits.dropped.values())
        fixed, gaps, openings = _edited_words(words, edits)
    else:
        kept, dropped = _drop_extra(words)
        fixed, gaps = _add_missing(kept, profile)

    def report(
        code: Code, place: Span, message: str, hint: str, expected: tuple[str, ...] = (), related: Span | None = None
    ) -> None:
        reporter.add(code, place, message, expected=expected, hint=hint, related=related, whole=True)

    if dropped:
        message = "This closing parenthesis closes nothing."
        if len(dropped) > 1:
            message = f"From here on, {len(dropped)} closing parentheses close nothing."
        advice = "remove it" if len(dropped) == 1 else "remove them"
        report("extra-parenthesis", dropped[0].span, message, advice, ("end of text",))
    for word in surplus:
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
    for word in openings:
        message = f"An opening parenthesis is missing before `{word.text}`."
        report("missing-parenthesis", word.span, message, f"write ({word.text}", ("(",))
    return fixed


def _edited_words(words: list[Word], edits: Edits) -> tuple[list[Word], list[_Gap], list[Word]]:
    """Returns the words after some edits, the closing parentheses that were missing, and the words not opened."""
    fixed: list[Word] = []
    frames: list[Word] = []
    gaps: list[_Gap] = []
    for position, word in enumerate(words):
        if position in edits.opened:
            opening = Word("OPEN", "(", word.offset, word.source, invented=True)
            fixed.append(opening)
            frames.append(opening)
        if position not in edits.dropped:
            fixed.append(word)
            if word.kind == "OPEN":
                frames.append(word)
            elif word.kind == "CLOSE":
                frames.pop()
        for behind, offset in edits.closed:
            if behind == position:
                closing = Word("CLOSE", ")", offset, word.source, invented=True)
                fixed.append(closing)
                gaps.append((closing.span, [frames.pop()]))
    return fixed, gaps, [words[position] for position in edits.opened]


def _drop_extra(words: list[Word]) -> tuple[list[Word], list[Word]]:
    """Returns the words without the parentheses that close nothing, and those parentheses."""
    depth = 0
    extra: list[int] = []
    ends: list[int] = []
    for position, word in enumerate(words):
        if word.kind == "OPEN":
            depth += 1
        elif word.kind == "CLOSE" and depth == 0:
            extra.append(position)
        elif word.kind == "CLOSE":
            depth -= 1
            if depth == 0:
                ends.append(position)
    takes_more = len(words) > 1 and words[1].key in ("and", "or", "define")
    if takes_more and len(extra) == 1 and len(ends) > 1 and depth == 0 and extra[0] == len(words) - 1:
        # In `(and (a)) (b))` the surplus one is not the last but the one that ended the formula too early.
        extra = [ends[0]]
    dropped = [words[position] for position in extra]
    surplus = set(extra)
    return [word for position, word in enumerate(words) if position not in surplus], dropped


def _add_missing(words: list[Word], profile: Profile) -> tuple[list[Word], list[_Gap]]:
    """Returns the words with every form closed, and the places where parentheses were missing."""
    spare = _spare_closings(words)
    added = 0
    fixed: list[Word] = []
    frames: list[_OpenForm] = []
    gaps: list[_Gap] = []

    def close(count: int) -> None:
        after = fixed[-1]
        closing = Word("CLOSE", ")", after.end, after.source, invented=True)
        gaps.append((closing.span, [frames.pop().opened for _ in range(count)]))
        fixed.extend([closing] * count)

    for position, word in enumerate(words):
        if word.kind == "OPEN":
            count = min(spare[position] - added, _frames_ended(frames, words[position + 1 : position + 2], profile))
            if count > 0:
                close(count)
                added += count
            if frames:
                frames[-1].forms += 1
            frames.append(_OpenForm(word))
        elif word.kind == "CLOSE":
            frames.pop()
        elif frames:
            frames[-1].take(word)
        fixed.append(word)
    if frames:
        # The end of a Markdown code fence is no part of what it encloses.
        fence = [fixed.pop()] if len(fixed) > 1 and fixed[-1].text.startswith(("```", "~~~")) else []
        close(len(frames))
        fixed += fence
    return fixed, gaps


def _spare_closings(words: list[Word]) -> list[int]:
    """Returns for each word how many closing parentheses may be added before it, so that each behind it has a match."""
    depth = 0
    depths = [depth := depth + (word.kind == "OPEN") - (word.kind == "CLOSE") for word in words]
    return list(accumulate(reversed(depths), min))[::-1]


def _frames_ended(frames: list[_OpenForm], following: list[Word], profile: Profile) -> int:
    """Returns how many open forms must have ended before a parenthesis that opens here; never the outermost."""
    if following and following[0].kind == "SECTION":
        return max(0, len(frames) - 1)
    count = 0
    while count < len(frames) - 1 and frames[-1 - count].is_complete(profile):
        count += 1
    return count


@dataclass(slots=True)
class _OpenForm:
    """A form that is still open: its parenthesis, its head, and how much it holds so far."""

    opened: Word
    head: Word | None = None
    words: int = 0
    forms: int = 0

    def take(self, word: Word) -> None:
        """Counts a word; the first thing in the form is its head when it is a word."""
        if self.head is None and self.forms == 0:
            self.head = word
        else:
            self.words += 1

    def is_complete(self, profile: Profile) -> bool:
        """Decides whether no further form can belong inside this one."""
        if self.head is None:
            return False
        if self.head.kind == "VARIABLE":
            return True
        if self.head.key in FORM_SHAPES:
            return self.forms >= inner_forms(self.head.key)
        return self.words > 0 and self.head.kind == "NAME" and not _may_hold_forms(self.head, profile)


def _may_hold_forms(head: Word, profile: Profile) -> bool:
    """Decides whether a form with this head has forms inside: a connective, a misspelt one, or a problem."""
    if head.key in profile.predicates:
        return False
    legal = (*profile.forms, *profile.absent_forms, "define")
    return head.key in legal or bool(near_names(head.text, legal))
