"""Slips in the choice of words: predicates, objects, truth values, question marks, and forms of PDDL."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from bddl.reading.terms import rewritten
from bddl.reading.words import Group, Word, words_in
from bddl.repair.draft import TextDraft, TextEdit
from bddl.syntax.codes import Slip
from bddl.syntax.names import SYNONYM_OF, near_names
from bddl.syntax.tree import QUANTIFIER_WORDS
from bddl.syntax.vocabulary import ROOM, VAGUE_PREDICATES, misplaced

_TRUTH = {"true": True, "false": False}
_ROBOT_WORDS = {"held", "holding", "grasped", "gripped", "in_hand", "in_gripper", "inhand", "picked_up", "grasping"}
_ROBOTS = {"robot", "agent", "gripper", "hand"}
# Heads of forms in which PDDL keeps a condition, and of forms that BDDL has nothing for.
_CONDITION_SECTIONS = {":precondition", ":effect", ":condition"}
_PDDL = {
    "increase", "decrease", "assign", "scale-up", "scale-down", "preference", "forall-before", "at", "over",
    ">=", "<=", ">", "<", "+", "*", "/", "count", "total-cost", ":action", ":parameters", ":metric", ":durative-action",
}  # fmt: skip
_COMPARISONS = {"=", "==", "equal", "equals", "!=", "eq"}


def judge_truth_values(draft: TextDraft) -> Iterator[TextEdit]:
    """Truth values go, `false` into a negation; a comparison of names is found, which BDDL cannot say."""
    for group in draft.groups:
        head, items = group.head, group.items
        if head is None:
            continue
        last = items[-1]
        value = _TRUTH.get(last.key) if isinstance(last, Word) else None
        if head.key in _COMPARISONS and len(items) == 3:
            if value is not None and isinstance(items[1], Group):
                yield TextEdit(group.offset, group.end, _valued(draft.quote(items[1:2]), value), "truth-constant")
            elif group.is_flat:
                yield TextEdit(group.offset, group.end, None, "equality")
        elif head.key in draft.profile.predicates and value is not None and len(items) > 2:
            yield TextEdit(group.offset, group.end, _valued(f"({draft.quote(items[:-1])})", value), "truth-constant")


def convert_pddl(draft: TextDraft) -> Iterator[TextEdit]:
    """Conditions leave their PDDL sections, `when` becomes `imply`; numbers and actions are found only."""
    for group in draft.groups:
        head = group.head
        if head is None:
            continue
        if head.key in _CONDITION_SECTIONS and len(group.items) == 2 and isinstance(group.items[1], Group):
            yield TextEdit(group.offset, group.end, draft.quote(group.items[1:]), "pddl-form")
        elif head.key == "when" and len(group.items) == 3:
            yield TextEdit(head.offset, head.end, "imply", "pddl-form")
        elif head.key in _PDDL and not (head.key in VAGUE_PREDICATES and group.is_flat):
            yield TextEdit(group.offset, group.end, None, "pddl-form")


def choose_predicates(draft: TextDraft) -> Iterator[TextEdit]:
    """Unknown heads become the predicate or connective that they mean, where there is just one."""
    taken = {"define", "problem", *draft.profile.words, *(word.key for word in draft.words if word.kind == "SECTION")}
    for group in draft.groups:
        head, flat = group.head, group.is_flat
        if head is None or head.kind != "NAME" or head.key in taken:
            continue
        names = [word.text for word in words_in(group.items[1:])]
        said = rewritten(head.key, names, draft.profile) if flat else ""
        if flat and head.key in _ROBOT_WORDS:
            held = [name for name in names if name.lower().rstrip("_0123456789") not in _ROBOTS]
            sayable = len(held) == 1 and "gripper" in draft.profile.builtin_objects
            text = f"(inside {held[0]} gripper)" if sayable else None
            yield TextEdit(group.offset, group.end, text, "robot-predicate")
        elif said:
            yield TextEdit(group.offset, group.end, said, "opposite-predicate")
        elif flat and head.key in VAGUE_PREDICATES:
            yield TextEdit(head.offset, head.end, None, "predicate-synonym")
        else:
            yield _renamed_head(draft, head, flat)


def choose_objects(draft: TextDraft) -> Iterator[TextEdit]:
    """Names that are no object become the object that they mean, where there is just one."""
    if draft.objects is None and not draft.declared:
        return
    known = {*(draft.objects or ()), *draft.profile.builtin_objects, *map(draft.profile.name_of, draft.declared)}
    bound, ordered = _bound_names(draft), sorted(known)
    for group in draft.groups:
        spec = draft.profile.predicates.get(group.head.key) if group.head is not None else None
        if spec is None:
            continue
        for position, item in enumerate(group.items[1:]):
            if not isinstance(item, Word) or item.text.removeprefix("?") in bound:
                continue
            room = position < spec.arity and spec.parameters[position] == ROOM
            name = draft.profile.name_of(item.text)
            if item.kind == "VARIABLE" and name in known and not draft.profile.free_marks:
                yield TextEdit(item.offset, item.end, name, "stray-question-mark")
            elif item.kind == "NAME" and name not in known and not room:
                yield _renamed_object(item, ordered, draft)


def swap_roles(draft: TextDraft) -> Iterator[TextEdit]:
    """Arguments of which the size of things tells that they are swapped change places."""
    objects = {**(draft.objects or {}), **draft.profile.builtin_objects}
    bound = _bound_names(draft)
    for group in draft.groups:
        words = words_in(group.items)
        if len(words) == len(group.items) == 3 and not bound.intersection(word.text.lstrip("?") for word in words):
            predicate, first, second = words
            if misplaced(predicate.key, objects.get(first.text, first.text), objects.get(second.text, second.text)):
                yield TextEdit(
                    group.offset, group.end, f"({predicate.text} {second.text} {first.text})", "swapped-roles"
                )


def _valued(text: str, value: bool) -> str:
    return text if value else f"(not {text})"


def _renamed_head(draft: TextDraft, head: Word, flat: bool) -> TextEdit:
    if not flat and near_names(head.text, ("define",)) and any(word.kind == "SECTION" for word in draft.words):
        return TextEdit(head.offset, head.end, "define", "misspelt-word")
    meant = SYNONYM_OF.get(head.key, "")
    if meant in draft.profile.words:
        slip: Slip = "predicate-synonym" if meant in draft.profile.predicates else "misspelt-word"
        return TextEdit(head.offset, head.end, meant, slip)
    near = near_names(head.text, draft.profile.words)
    if len(near) == 1 and (near[0] in draft.profile.predicates) == flat:
        return TextEdit(head.offset, head.end, near[0], "misspelt-word")
    return TextEdit(head.offset, head.end, None, "misspelt-word" if near else "invented-predicate")


def _renamed_object(word: Word, known: Sequence[str], draft: TextDraft) -> TextEdit:
    """Returns the change of an unknown name; to another one only where no other object can be meant.

    A name with another number may be a second object of the kind, and a name that the text uses already is taken.
    """
    same = [name for name in known if name.casefold() == word.text.casefold()]
    if len(same) == 1:
        return TextEdit(word.offset, word.end, same[0], "letter-case")
    near = near_names(word.text, known)
    if not near:
        return TextEdit(word.offset, word.end, None, "invented-object")
    number, own = (name[len(name.rstrip("0123456789")) :] for name in (word.text, near[0]))
    used = any(other.text == near[0] for other in draft.words)
    certain = len(near) == 1 and not used and number in ("", own)
    return TextEdit(word.offset, word.end, near[0] if certain else None, "object-variant")


def _bound_names(draft: TextDraft) -> frozenset[str]:
    """Returns the variables that some quantifier of the text binds, without their question marks."""
    found: set[str] = set()
    for group in draft.groups:
        if group.head is not None and group.head.key in QUANTIFIER_WORDS:
            for item in group.items[1:]:
                words = words_in(item.items if isinstance(item, Group) else [item])
                found.update(word.text[1:] for word in words if word.kind == "VARIABLE")
    return frozenset(found)
