"""What a goal concerns in a scene, and what the roles of a decomposition show before any formula is written."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace

import bddl
from llm.structured.conversation import finding
from llm.structured.prompting import formula_pattern
from llm.structured.schema import Form, Pattern
from oag import Diagnostic, Scene, SimpleTask, Task
from oag.model.reading import UNREADABLE
from oag.model.symbols import GRIPPER, Kind, has_inside
from oag.primitives.cargo import RESTING
from oag.wellformed import kind_problem


def stakes(goal: bddl.Formula, scene: Scene) -> bddl.Formula:
    """Return a goal without parts that hold at the start and are about nothing that the rest concerns.

    A small model makes a subtask of each part that it reads.
    """
    parts, stated, near = bddl.conjuncts(goal), _stated(scene), concerns(goal, scene)
    kept = [part for part in parts if part not in stated or any(near & {*atom.args} for atom in bddl.atoms(part))]
    return goal if len(kept) in (0, len(parts)) else _conjunction(kept)


def distinct(goal: bddl.Formula) -> bddl.Formula:
    """Return a goal with each of its parts once; a small model that has begun to repeat one goes on with it."""
    parts = bddl.conjuncts(goal)
    kept = tuple(dict.fromkeys(parts))
    return goal if len(kept) in (0, len(parts)) else _conjunction(kept)


def _conjunction(parts: Sequence[bddl.Formula]) -> bddl.Formula:
    return bddl.parse_formula(f"(and {' '.join(map(bddl.format, parts))})" if parts[1:] else bddl.format(parts[0]))


def concerns(goal: bddl.Formula, scene: Scene) -> frozenset[str]:
    """Return what the parts of a goal that do not hold yet are about, and what these things stand in.

    A plate in a refrigerator takes what lies on it along; a counter below a bowl has no part in it.
    """
    named = {name for atom in _open_atoms(goal, scene) for name in atom.args}
    return _with_carriers(named, _rests(scene))


def doors(goal: bddl.Formula, scene: Scene) -> frozenset[str]:
    """Return the fixtures with a door that a goal asks for, or behind which it takes something or puts it."""
    atoms = _open_atoms(goal, scene)
    named = {atom.args[-1] for atom in atoms if atom.predicate in ("open", "inside")}
    for atom in (atom for atom in atoms if atom.predicate in RESTING):
        thing, place = atom.args[0], atom.args[-1]
        # On top of a cabinet nothing is behind its door.
        named |= _with_carriers({thing}, _rests(scene)) | (_with_carriers({place}, _rests(scene)) - {place})
    concerned = [scene.objects[name] for name in named if name in scene.objects]
    return frozenset(thing.id for thing in concerned if thing.kind is Kind.ARTICULATED)


def bare_task(scene: Scene, subtasks: Iterable[SimpleTask] = (), goal: bddl.Formula = UNREADABLE) -> Task:
    """Return a task of what is known so far, for the checks of form."""
    return Task("task", "", goal, True, tuple(subtasks), {}, scene)


def role_forms(ids: Sequence[str], goal: bddl.Formula, scene: Scene, named: Collection[str] = ()) -> Sequence[Form]:
    """Return the forms of a simple task by its kind: open or close a fixture, pick an item up, or put it down.

    The name of a task tells its kind. Only a door that the goal concerns, or the query names, is opened. Only what has
    an inside, or on which something lies at first or at the end, is the place of another item. What is put down may be
    picked up in the same entry, from where it is at first.

    Args:
        ids: The objects that are shown.
        goal: The task goal.
        scene: The scene.
        named: The objects that the query names.
    """
    concerned = doors(goal, scene) | {key for key in named if opens(key, scene)}
    atoms = bddl.ground(goal, scene.categories).atoms
    carriers = {place for _, place in _resting(scene)} | {atom.args[-1] for atom in atoms if atom.predicate in RESTING}
    places = [key for key in ids if scene[key].role == "A" or key in carriers or has_inside(scene[key].category)]
    turned = {"task_activity_name": Pattern("^(open|close)_[a-z0-9_]+$"), "support_init": [""], "support_goal": [""]}
    forms: list[Form] = [{**turned, "target": [key for key in ids if key in concerned]}]
    for item in (key for key in ids if scene[key].role == "B"):
        others = [key for key in places if key != item]
        taken = {"task_activity_name": Pattern("^pick_up_[a-z0-9_]+$"), "target": [item], "support_goal": [""]}
        put = {"task_activity_name": Pattern("^put_[a-z0-9_]+$"), "target": [item]}
        # Where a scene does not tell what a thing is in or on, nobody can name it.
        forms.append({**taken, "support_init": others if has_place(item, scene) else ["", *others]})
        forms.append({**put, "support_init": [""], "support_goal": others})
        for home in (place for thing, place in _resting(scene) if thing == item and place in ids):
            forms.append({**put, "support_init": [home], "support_goal": [key for key in others if key != home]})
    return [form for form in forms if all(form.values())]


def opens(key: str, scene: Scene) -> bool:
    """Decide whether something of a scene can be opened."""
    return kind_problem(bddl.Atom("open", (key,)), scene) is None


def condition_forms(subtasks: Sequence[SimpleTask], ids: Sequence[str], scene: Scene) -> Sequence[Form]:
    """Return the form of each simple task's conditions: its target is where its roles have it, and not elsewhere.

    Args:
        subtasks: The simple tasks with their roles.
        ids: The objects that are shown.
        scene: The scene.
    """
    forms: list[Form] = []
    for number, part in enumerate(subtasks, start=1):
        ends = {"init": part.support_init, "goal": part.support_goal}
        item = scene[part.target].role == "B"
        # Nothing is known of the place of an item that is picked up from nowhere.
        free = not item or not any(ends.values())
        patterns = {
            which: formula_pattern(scene, ids) if free else formula_pattern(scene, ids, part.target, [end or GRIPPER])
            for which, end in ends.items()
        }
        forms.append({"sub_task": [number], **{which: Pattern(f"^{one}$") for which, one in patterns.items() if one}})
    return forms


def handling_findings(subtasks: Sequence[SimpleTask], goal: bddl.Formula, scene: Scene) -> Iterator[Diagnostic]:
    """Yield what the roles alone show.

    A thing is picked up where it is not, is put down but never picked up, or is never put where it shall be.
    """
    facts = [literal for fact in scene.facts for literal in bddl.literals(fact) or ()]
    rests, known = _resting(scene), scene.closed.issuperset(RESTING)
    placed = {one.atom.args[0] for one in facts if one.value and one.atom.predicate in RESTING}
    taken = {one.atom.args[0] for one in facts if one.value and one.atom.args[1:] == (GRIPPER,)}
    for index, part in enumerate(subtasks):
        place = f"T{index + 1} {part.name}"
        around = _with_carriers({part.target}, rests)
        homes, start = [place for thing, place in rests if thing == part.target], part.support_init
        # What has been carried away, or stands on what has, is where the plan has put it.
        if known and homes and start in scene.objects and start not in around and not taken & around:
            message = f"{part.target} is not picked up from {start}: it is at {' and '.join(homes)}"
            found = finding("answer/not-there", message, place, subtask=index, hint=f"its support_init is {homes[0]}")
            yield replace(found, fixes=(f'T{index + 1}: "target": "{part.target}", "support_init": "{homes[0]}"',))
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


def _resting(scene: Scene) -> tuple[tuple[str, str], ...]:
    """Return what is stated to lie in or on something, with that, in the order of the facts."""
    stated = (part for fact in scene.facts for part in bddl.conjuncts(fact))
    return tuple((atom.args[0], atom.args[1]) for atom in stated if isinstance(atom, bddl.Atom) and _is_rest(atom))


def _rests(scene: Scene) -> set[tuple[str, str]]:
    """Return what stands in something, or on an item, with that: it goes where that goes, or is behind its door."""
    inside = {atom.args for fact in _stated(scene) for atom in bddl.atoms(fact) if atom.predicate == "inside"}
    return {
        (thing, place)
        for thing, place in _resting(scene)
        if place in scene.objects and ((thing, place) in inside or scene[place].role == "B")
    }
