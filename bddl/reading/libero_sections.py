"""The sections that LIBERO adds to a problem: instruction, regions, fixtures, objects of interest and styles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from bddl.reading.sections import ObjectsReader, ProblemDraft, SectionReader
from bddl.reading.words import Group, Item, Word
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.libero import ROWS, SECTION_START, STYLE_ATTRIBUTES, Rectangle, Region, SceneStyle, read_number
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
    found: dict[str, Region] = {}
    for item in sections[0].items[1:]:
        region = _region(item, draft.reporter)
        if region is not None and region.key in found:
            earlier = found[region.key]
            hint = (
                f"`{earlier.target}` + `{earlier.name}` and `{region.target}` + `{region.name}` read alike: rename one"
            )
            if (earlier.name, earlier.target) == (region.name, region.target):
                hint = "keep one of them, or give the second another name"
            draft.reporter.add(
                "repeated-object",
                item.span,
                f"The region `{region.key}` is defined twice.",
                hint=hint,
                related=earlier.span,
            )
        elif region is not None:
            found[region.key] = region
    draft.fields["regions"] = tuple(found.values())
    draft.terms.update(dict.fromkeys(found, REGION))


def _read_fixtures(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    reader = ObjectsReader(draft)
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


def _region(item: Item, reporter: Reporter) -> Region | None:
    """Returns a region, or None when it is not well formed; whatever is wrong is reported."""
    head = item.head if isinstance(item, Group) else None
    if not isinstance(item, Group) or head is None or head.kind != "NAME":
        _report(reporter, item.span, "A region belongs here.", "(NAME (:target NAME) (:ranges ...))")
        return None
    attributes = _attributes(item, reporter)
    given = attributes.get(":target")
    if given is None:
        message = f"The region `{head.text}` says of no object that it is a part."
        _report(reporter, head.span, message, _SHAPES[":target"])
        return None
    target = given.items[1] if len(given.items) == 2 else None
    if not isinstance(target, Word) or target.kind != "NAME":
        _report(reporter, given.span, "The name of one object belongs here.", _SHAPES[":target"])
        return None
    yaw = _rows(attributes, ":yaw_rotation", 2, reporter)
    colour = _rows(attributes, ":rgba", 4, reporter)
    return Region(
        head.text.lower(),
        target.text.lower(),
        tuple(Rectangle(*row) for row in _rows(attributes, ":ranges", 4, reporter)),
        # With several ranges of yaw the last one counts, as in LIBERO.
        (yaw[-1][0], yaw[-1][1]) if yaw else None,
        (colour[0][0], colour[0][1], colour[0][2], colour[0][3]) if colour else None,
        span=item.span,
    )


def _attributes(region: Group, reporter: Reporter) -> dict[str, Group]:
    """Returns the attributes of a region by name; unknown and repeated ones are reported."""
    found: dict[str, Group] = {}
    for item in region.items[1:]:
        head = item.head if isinstance(item, Group) else None
        if not isinstance(item, Group) or head is None or head.key not in _SHAPES:
            near = near_names(head.key, _SHAPES) if head is not None else ()
            place = item.span if head is None else head.span
            hint = f"did you mean {near[0]}?" if near else f"the attributes are: {', '.join(_SHAPES.values())}"
            reporter.add(
                "bad-section", place, "A region has no such attribute.", expected=near or tuple(_SHAPES), hint=hint
            )
        elif head.key in found:
            reporter.add(
                "repeated-section",
                head.span,
                f"The region has `{head.key}` twice.",
                hint="keep one of them",
                related=found[head.key].span,
            )
        else:
            found[head.key] = item
    return found


def _rows(attributes: Mapping[str, Group], name: str, width: int, reporter: Reporter) -> list[tuple[float, ...]]:
    """Returns the rows of numbers of an attribute; whatever is no such row is reported."""
    attribute = attributes.get(name)
    if attribute is None:
        return []
    inside = attribute.items[1] if len(attribute.items) == 2 else None
    if not isinstance(inside, Group):
        _report(reporter, attribute.span, "Numbers in parentheses belong here.", _SHAPES[name])
        return []
    found: list[tuple[float, ...]] = []
    for row in inside.items if name in ROWS else (inside,):
        if not isinstance(row, Group) or len(row.items) != width:
            _report(reporter, row.span, f"{width} numbers in parentheses belong here.", _SHAPES[name])
            continue
        numbers = [read_number(part.text) if isinstance(part, Word) else None for part in row.items]
        for part, number in zip(row.items, numbers, strict=True):
            if number is None:
                _report(reporter, part.span, "A number belongs here, such as 0.25 or -pi/2.", "a number")
        known = tuple(number for number in numbers if number is not None)
        found += [known] if len(known) == width else []
    return found


def _report(reporter: Reporter, place: Span, message: str, shape: str) -> None:
    reporter.add("bad-section", place, message, expected=(shape,), hint=f"write {shape}")
