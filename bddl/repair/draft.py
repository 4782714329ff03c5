"""A text on its way to being corrected: what the correction has to know of it, and changes to it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from bddl.reading.words import Forest, Group, Item, Word, read_forest, read_words, words_in, words_of
from bddl.syntax.codes import Slip
from bddl.syntax.diagnostic import Source
from bddl.syntax.profiles import Profile


class TextEdit(NamedTuple):
    """A change of a text, and the slip that it puts right.

    Attributes:
        start: Offset of the first character to be replaced.
        end: Offset behind the last one; equal to `start` for an insertion.
        text: What to write instead, or None when only the author knows.
        slip: What went wrong there.
    """

    start: int
    end: int
    text: str | None
    slip: Slip


@dataclass(frozen=True)
class TextDraft:
    """A text with its dialect and the objects that it may speak of.

    Attributes:
        text: The text.
        profile: Its dialect.
        objects: Category of each known object, or None when any name may be an object.
        given: Its forms and loose words, where they are known already; else they are read when they are needed.
    """

    text: str
    profile: Profile
    objects: Mapping[str, str] | None = None
    given: Forest | None = None

    @cached_property
    def words(self) -> list[Word]:
        """Its words and parentheses."""
        return read_words(Source(self.text)) if self.given is None else words_of(self.given)

    @cached_property
    def forest(self) -> Forest:
        """Its forms and loose words; nothing when the parentheses do not match."""
        return self.balanced or ()

    @cached_property
    def balanced(self) -> Forest | None:
        """Its forms and loose words, or None when the parentheses do not match."""
        return read_forest(Source(self.text)) if self.given is None else self.given

    @cached_property
    def groups(self) -> list[Group]:
        """Every form in it, outer ones first, from left to right."""
        found: list[Group] = []
        pending = [item for item in reversed(self.forest) if isinstance(item, Group)]
        while pending:
            found.append(group := pending.pop())
            pending.extend(item for item in reversed(group.items) if isinstance(item, Group))
        return found

    @cached_property
    def declared(self) -> frozenset[str]:
        """The names that a section `:objects` declares."""
        sections = (group for group in self.groups if group.head is not None and group.head.key == ":objects")
        return frozenset(word.text for group in sections for word in words_in(group.items))

    def quote(self, items: Iterable[Item]) -> str:
        """Returns the text of some items, joined by blanks."""
        return " ".join(self.text[item.offset : item.end] for item in items)

    def edited(self, edits: Iterable[TextEdit]) -> TextDraft:
        """Returns the draft after some changes; of changes that overlap, the one that begins first is made."""
        pieces: list[str] = []
        position = 0
        for edit in sorted(edits, key=lambda edit: (edit.start, edit.end)):
            if edit.start >= position and edit.text is not None:
                pieces += [self.text[position : edit.start], edit.text]
                position = edit.end
        return TextDraft("".join([*pieces, self.text[position:]]), self.profile, self.objects)
