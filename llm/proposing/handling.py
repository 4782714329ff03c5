"""What a goal concerns in a scene, and what the roles of a decomposition show before any formula is written."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import bddl
from llm.structured.conversation import finding
from oag import Diagnostic, Scene, SimpleTask
from oag.model.symbols import GRIPPER, Kind
from oag.primitives.cargo import RESTING


def stakes(goal: bddl.Formula, scene: Scene) -> bddl.Formula:
    """Return a goal without parts that hold at the start and are about nothing that the rest concerns.

    A small model makes a subtask of each part that it reads.
    """
    parts, stated, near = bddl.conjuncts(goal), _stated(scene), concerns(goal, scene)
    kept = [part for part in parts if part not in stated or any(near & {*atom.args} for atom in bddl.atoms(part))]
    if len(kept) in (0, len(parts)):
        return goal
    return bddl.parse_formula(f"(and {' '.join(map(bddl.format, kept))})" if kept[1:] else bddl.format(kept[0]))


def concerns(goal: bddl.Formula, scene: Scene) -> frozenset[str]:
    """Return what the parts of a goal that do not hold yet are about, and what these things stand in.

    A plate in a refrigerator takes what lies on it along; a counter below a bowl has no part in it.
    """
    named = {name for atom in _open_atoms(goal, scene) for name in atom.args}
    return _with_carriers(named, _rests(scene))


def needs_doors(goal: bddl.Formula, scene: Scene) -> bool:
    """Decide whether a goal asks for a door, puts something behind one, or takes it from there."""
    atoms = _open_atoms(goal, scene)
    behind = {atom.args[-1] for atom in atoms if atom.predicate in ("open", "inside")}
    moved = _with_carriers({atom.args[0] for atom in atoms if atom.predicate in RESTING}, _rests(scene))
    concerned = (scene.objects.get(name) for name in behind | moved)
    return any(thing is not None and thing.kind is Kind.ARTICULATED for thing in concerned)


def handling_findings(subtasks: Sequence[SimpleTask], goal: bddl.Formula, scene: Scene) -> Iterator[Diagnostic]:
    """Yield what the roles alone show: a thing that is put down but never picked up, or never put where it shall be."""
    facts = [literal for fact in scene.facts for literal in bddl.literals(fact) or ()]
    placed = {one.atom.args[0] for one in facts if one.value and one.atom.predicate in RESTING}
    taken = {one.atom.args[0] for one in facts if one.value and one.atom.args[1:] == (GRIPPER,)}
    for index, part in enumerate(subtasks):
        place = f"T{index + 1} {part.name}"
        taken |= {part.target} if part.support_init else set()
        # Where a scene does not say what a thing stands in or on, nobody can name it.
        if part.support_goal and part.target in placed - taken:
            hint = f"before it, a subtask with target {part.target} and as support_init what it stands in or on"
            yield finding("answer/not-held", f"nothing picks {part.target} up before", place, subtask=index, hint=hint)
        if part.support_goal and part.support_goal == part.support_init:
            message = f"it puts {part.target} back where it takes it from, {part.support_goal}"
            hint = "leave support_init empty where the hand holds the target already"
            yield finding("answer/not-put", message, place, subtask=index, hint=hint)
    put = {(part.target, part.support_goal) for part in subtasks if part.support_goal}
    carriers = {*_rests(scene), *put}
    for literal in bddl.literals(goal) or ():
        if not literal.value or literal.atom.predicate not in RESTING or literal in facts:
            continue
        thing, where = literal.atom.args
        along = _with_carriers({thing}, {pair for pair in carriers if pair[1] != where})
        item = scene.objects.get(thing)
        # What cannot be carried is a mistake of the goal, which the graph finds.
        if where != GRIPPER and item is not None and item.role == "B" and not any((one, where) in put for one in along):
            message = f"no subtask puts {thing} where the goal has it: {bddl.format(literal.atom)}"
            hint = f"give the subtask that puts {thing} down the support_goal {where}; one before it picks it up"
            yield finding("answer/not-put", message, "sub_tasks", hint=hint)


def has_place(thing: str, scene: Scene) -> bool:
    """Decide whether a scene says what a thing stands in or on."""
    return any(atom.args[0] == thing for fact in _stated(scene) for atom in bddl.atoms(fact) if _is_rest(fact))


def _with_carriers(things: set[str], rests: Collection[tuple[str, str]]) -> frozenset[str]:
    """Return things with what they stand in or on, what that stands in, and so on."""
    found = set(things)
    while more := {place for thing, place in rests if thing in found} - found:
        found |= more
    return frozenset(found)


def _stated(scene: Scene) -> set[bddl.Formula]:
    return {literal for fact in scene.facts for literal in bddl.conjuncts(fact)}


def _open_atoms(goal: bddl.Formula, scene: Scene) -> list[bddl.Atom]:
    """Return the atoms of the parts of a goal that are not stated, quantifiers expanded."""
    stated = _stated(scene)
    parts = [part for part in bddl.conjuncts(goal) if part not in stated]
    return [atom for part in parts for atom in bddl.ground(part, scene.categories).atoms]


def _is_rest(fact: bddl.Formula) -> bool:
    return isinstance(fact, bddl.Atom) and fact.predicate in RESTING and len(fact.args) == 2


def _rests(scene: Scene) -> set[tuple[str, str]]:
    """Return what stands in something, or on an item, with that: it goes where that goes, or is behind its door."""
    atoms = [fact for fact in _stated(scene) if isinstance(fact, bddl.Atom) and _is_rest(fact)]
    found = set()
    for atom in atoms:
        thing, place = atom.args
        holder = scene.objects.get(place)
        if holder is not None and (atom.predicate == "inside" or holder.role == "B"):
            found.add((thing, place))
    return found
