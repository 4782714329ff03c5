"""The sections that LIBERO adds to a problem: instruction, regions, fixtures, objects of interest and styles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from bddl.libero import SECTION_START, STYLE_ATTRIBUTES, SceneStyle
from bddl.names import near_names
from bddl.reading.forest import Group, Item, Word
from bddl.reading.objects import ObjectsReader
from bddl.reading.problem_draft import ProblemDraft, SectionReader
from bddl.reading.regions import RegionReader
from bddl.reading.terms import TermReader

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
