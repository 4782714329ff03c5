"""Which dialect a text is written in, as far as its domain, its categories and its sections tell."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from bddl.syntax.diagnostic import Reporter
from bddl.syntax.names import near_names
from bddl.syntax.profiles import PROFILES, Profile
from bddl.syntax.vocabulary import SYNSET

DEFAULT = "scene"
_COMMENT = re.compile(r";[^\n]*")
_DOMAIN = re.compile(r"\(\s*:domain\s+([^\s();]+)", re.IGNORECASE)
_SECTION = re.compile(r"\(\s*(:[\w-]+)")
_SYNSET_CATEGORY = re.compile(rf"\s-\s+{SYNSET.pattern}(?![^\s();])", re.IGNORECASE)


class _Signs(NamedTuple):
    """What tells the dialect of a text.

    Attributes:
        domain: The domain that it names, in lower case; "" for none.
        offset: Where that name begins.
        length: The length of that name.
        styles: The dialects that it is written like, whatever domain it names.
    """

    domain: str
    offset: int
    length: int
    styles: tuple[str, ...]


def dialect_of(text: str) -> str:
    """Returns the name of the profile that a text is to be read with.

    That is the one that the text's domain belongs to. A domain that only resembles a known one counts as that when
    the text is written like its dialect: with synsets for categories, or with sections that only LIBERO has. So a
    slip in the domain's name does not change what the rest of the text means.

    Example:
        >>> dialect_of("(define (problem p) (:domain omnigibsn) (:objects apple.n.01_1 - apple.n.01) ...")
        'behavior'
        >>> dialect_of("(define (problem p) (:domain kitchen) (:objects apple_0 - apple) ...")
        'scene'
    """
    signs = _signs_in(text)
    exact = next((name for name, profile in PROFILES.items() if signs.domain in profile.domains), None)
    return exact or next(_by_style(signs), DEFAULT)


def report_other_dialect(text: str, profile: Profile, reporter: Reporter) -> None:
    """Reports that a text with mistakes is written in another dialect than the one it was read in, if it is."""
    signs = _signs_in(text)
    meant = next(_by_style(signs), None)
    if meant is None or PROFILES[meant].domains == profile.domains:
        return
    # Whatever else is reported may follow from this, so it is never an echo.
    reporter.restrict(["other-profile"])
    reporter.add(
        "other-profile",
        reporter.place(signs.offset, signs.length),
        f"The text is written in the profile `{meant}`, and it was read in the profile `{profile.name}`.",
        hint=f'pass profile="{meant}"',
        severity="warning",
    )


def _signs_in(text: str) -> _Signs:
    plain = _COMMENT.sub(lambda comment: " " * len(comment.group()), text)
    found = _DOMAIN.search(plain)
    sections = {match.group(1).lower() for match in _SECTION.finditer(plain)}
    styles = [name for name, profile in PROFILES.items() if sections & _own_sections(profile)]
    if _SYNSET_CATEGORY.search(plain):
        styles += [name for name, profile in PROFILES.items() if profile.category_name is SYNSET]
    domain, offset = ("", 0) if found is None else (found.group(1), found.start(1))
    return _Signs(domain.lower(), offset, len(domain), tuple(styles))


def _own_sections(profile: Profile) -> frozenset[str]:
    """Returns the sections of a dialect that scenes do not have."""
    return frozenset(profile.sections).difference(PROFILES[DEFAULT].sections)


def _by_style(signs: _Signs) -> Iterator[str]:
    """Yields the dialects that a text is written like and whose domain it names, if not letter by letter."""
    for name in signs.styles:
        domains = PROFILES[name].domains
        if signs.domain in domains or near_names(signs.domain, domains):
            yield name
