"""The sections that LIBERO adds to a problem: instruction, regions, fixtures, objects of interest and styles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from bddl.reading.sections import ObjectsReader, ProblemDraft, SectionReader
from bddl.reading.terms import TermReader
from bddl.reading.words import Group, Item, Word
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.libero import SECTION_START, STYLE_ATTRIBUTES, Rectangle, Region, SceneStyle, read_number
from bddl.syntax.names import near_names
from bddl.syntax.tree import Span

# The category of regions, for quantifiers and messages.
REGION = "region"


def _read_language(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    section = sections[0]
    if section.head is None:
        return
    start = section.head.span.offset + section.head.span.length
    # The words were hidden from the grammar; the text itself has them.
    said = draft.reporter.text[start : section.span.offset + section.span.length - 1]
    inner = SECTION_START.search(said)
    if inner is not None:
        said = said[: inner.start()]
        draft.reporter.add(
            "missing-parenthesis",
            draft.reporter.place(start + len(said.rstrip())),
            "The instruction does not end before the next section begins.",
            expected=(")",),
            hint="add ) here",
            related=section.opened.span,
        )
    draft.fields["language"] = said.strip()


def _read_regions(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    regions = RegionReader(draft.reporter).read(sections[0])
    draft.fields["regions"] = tuple(regions)
    draft.terms.update({region.key: REGION for region in regions})


def _read_fixtures(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    terms = TermReader(draft.profile, draft.scene, draft.reporter)
    reader = ObjectsReader(draft.profile, terms, draft.reporter)
    reader.read(sections[0])
    draft.fields["fixtures"] = reader.objects
    draft.terms.update({fixture.name: fixture.category for fixture in reader.objects})


def _read_objects_of_interest(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    """Reads the names; it comes behind the objects, so that all names are known."""
    known = {**{thing.name: thing.category for thing in draft.objects}, **draft.terms}
    names: list[str] = []
    for item in sections[0].items[1:]:
        if not isinstance(item, Word) or item.kind != "NAME":
            draft.reporter.add("not-a-name", item.span, "The name of an object or a region belongs here.", hint="")
            continue
        name = draft.profile.name_of(item.text)
        if name not in known:
            near = near_names(name, known)
            draft.reporter.add(
                "unknown-object",
                item.span,
                f"There is no object, fixture or region `{name}`.",
                expected=near or tuple(known),
                hint=f"did you mean {' or '.join(near)}?" if near else "",
            )
        names.append(name)
    draft.fields["objects_of_interest"] = tuple(names)


def _read_styles(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    styles = [_style(draft, item) for item in sections[0].items[1:]]
    draft.fields["styles"] = tuple(style for style in styles if style is not None)


def _style(draft: ProblemDraft, item: Item) -> SceneStyle | None:
    """Returns how one part of the scene looks, or None when that is not well formed, which is reported."""
    head = item.head if isinstance(item, Group) else None
    if isinstance(item, Group) and head is not None and head.kind == "NAME":
        said: dict[str, str] = {}
        for part in item.items[1:]:
            words = part.items if isinstance(part, Group) else ()
            if len(words) == 2 and isinstance(words[0], Word) and isinstance(words[1], Word):
                said[words[0].key] = words[1].text
        if len(said) == len(item.items) - 1 and said.keys() <= set(STYLE_ATTRIBUTES):
            return SceneStyle(head.text, said.get(":floor"), said.get(":wall"))
    draft.reporter.add(
        "bad-section",
        item.span,
        "A part of the scene belongs here, with the style of its floor or wall.",
        expected=("(NAME (:floor STYLE) (:wall STYLE))",),
        hint="write (NAME (:floor STYLE) (:wall STYLE))",
    )
    return None


LIBERO_READERS: Mapping[str, SectionReader] = MappingProxyType(
    {
        ":language": _read_language,
        ":regions": _read_regions,
        ":fixtures": _read_fixtures,
        ":obj_of_interest": _read_objects_of_interest,
        ":scene_properties": _read_styles,
    }
)

_SHAPES = {
    ":target": "(:target NAME)",
    ":ranges": "(:ranges ((X_MIN Y_MIN X_MAX Y_MAX) ...))",
    ":yaw_rotation": "(:yaw_rotation ((LEAST GREATEST)))",
    ":rgba": "(:rgba (RED GREEN BLUE ALPHA))",
}


class RegionReader:
    """Reads the regions of one problem.

    Args:
        reporter: Receives the diagnostics.
    """

    def __init__(self, reporter: Reporter) -> None:
        self._reporter = reporter

    def read(self, section: Group) -> list[Region]:
        """Returns the regions of a section that are well formed; the others are reported."""
        found: dict[str, Region] = {}
        for item in section.items[1:]:
            region = self._region(item)
            if region is None:
                continue
            earlier = found.get(region.key)
            if earlier is not None:
                self._reporter.add(
                    "repeated-object",
                    item.span,
                    f"The region `{region.key}` is defined twice.",
                    hint=_clash(earlier, region),
                    related=earlier.span,
                )
            else:
                found[region.key] = region
        return list(found.values())

    def _region(self, item: Item) -> Region | None:
        head = item.head if isinstance(item, Group) else None
        if not isinstance(item, Group) or head is None or head.kind != "NAME":
            self._report(item.span, "A region belongs here.", "(NAME (:target NAME) (:ranges ...))")
            return None
        attributes = self._attributes(item)
        if ":target" not in attributes:
            self._report(head.span, f"The region `{head.text}` says of no object that it is a part.", "(:target NAME)")
            return None
        target = self._target(attributes[":target"])
        if target is None:
            return None
        yaw = self._rows(attributes.get(":yaw_rotation"), 2)
        colour = self._row(attributes.get(":rgba"), 4)
        return Region(
            head.text.lower(),
            target,
            tuple(Rectangle(*row) for row in self._rows(attributes.get(":ranges"), 4)),
            # With several ranges of yaw the last one counts, as in LIBERO.
            None if not yaw else (yaw[-1][0], yaw[-1][1]),
            None if colour is None else (colour[0], colour[1], colour[2], colour[3]),
            span=item.span,
        )

    def _attributes(self, region: Group) -> dict[str, Group]:
        """Returns the attributes of a region by name; unknown and repeated ones are reported."""
        found: dict[str, Group] = {}
        for item in region.items[1:]:
            head = item.head if isinstance(item, Group) else None
            if not isinstance(item, Group) or head is None or head.key not in _SHAPES:
                near = near_names(head.key, _SHAPES) if head is not None else ()
                place = item.span if head is None else head.span
                hint = f"did you mean {near[0]}?" if near else f"the attributes are: {', '.join(_SHAPES.values())}"
                self._reporter.add(
                    "bad-section", place, "A region has no such attribute.", expected=near or tuple(_SHAPES), hint=hint
                )
            elif head.key in found:
                self._reporter.add(
                    "repeated-section",
                    head.span,
                    f"The region has `{head.key}` twice.",
                    hint="keep one of them",
                    related=found[head.key].span,
                )
            else:
                found[head.key] = item
        return found

    def _target(self, attribute: Group) -> str | None:
        only = attribute.items[1] if len(attribute.items) == 2 else None
        if isinstance(only, Word) and only.kind == "NAME":
            return only.text.lower()
        self._report(attribute.span, "The name of one object belongs here.", _SHAPES[":target"])
        return None

    def _rows(self, attribute: Group | None, width: int) -> list[tuple[float, ...]]:
        """Returns the rows of numbers of an attribute; whatever is no such row is reported."""
        rows = self._inner(attribute)
        if rows is None:
            return []
        read = [self._numbers(row, width, attribute) for row in rows.items]
        return [row for row in read if row is not None]

    def _row(self, attribute: Group | None, width: int) -> tuple[float, ...] | None:
        """Returns the one row of numbers of an attribute, or None when there is none or it was reported."""
        row = self._inner(attribute)
        return None if row is None else self._numbers(row, width, attribute)

    def _inner(self, attribute: Group | None) -> Group | None:
        if attribute is None:
            return None
        only = attribute.items[1] if len(attribute.items) == 2 else None
        if isinstance(only, Group):
            return only
        self._report(attribute.span, "Numbers in parentheses belong here.", self._shape(attribute))
        return None

    def _numbers(self, item: Item, width: int, attribute: Group | None) -> tuple[float, ...] | None:
        """Returns the numbers of one row, or None when the row is wrong, which is reported."""
        if isinstance(item, Group) and len(item.items) == width:
            numbers = [read_number(part.text) if isinstance(part, Word) else None for part in item.items]
            for part, number in zip(item.items, numbers, strict=True):
                if number is None:
                    self._report(part.span, "A number belongs here, such as 0.25 or -pi/2.", "a number")
            known = tuple(number for number in numbers if number is not None)
            return known if len(known) == width else None
        self._report(item.span, f"{width} numbers in parentheses belong here.", self._shape(attribute))
        return None

    def _shape(self, attribute: Group | None) -> str:
        head = attribute.head if attribute is not None else None
        return _SHAPES.get(head.key, "") if head is not None else ""

    def _report(self, place: Span, message: str, shape: str) -> None:
        self._reporter.add("bad-section", place, message, expected=(shape,), hint=f"write {shape}")


def _clash(earlier: Region, later: Region) -> str:
    """Returns what to do about two regions with one key."""
    if (earlier.name, earlier.target) == (later.name, later.target):
        return "keep one of them, or give the second another name"
    return f"`{earlier.target}` + `{earlier.name}` and `{later.target}` + `{later.name}` read alike: rename one"
