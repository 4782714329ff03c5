"""Candidates for fixes of well-formed plans: changed conditions, subtasks and flows.

Conditions: roles, objects, initial condition or goal of a subtask. Subtasks: moved, exchanged, inserted or left out.
Flows: a step inserted, left out, replaced or moved, or the whole flow searched again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isqrt
from typing import NamedTuple

import bddl
from bddl.ast import Quantified
from oag.flows import (
    CLOSE,
    OPEN,
    PICK,
    PLACE,
    TAKE_OUT,
    PlanSearch,
    PrimitiveFlow,
    TooManyStates,
    flows,
    force_flow,
    run_flow,
)
from oag.model.actions import Action, ActionFlow
from oag.model.scene import Scene
from oag.model.symbols import (
    EEF,
    EMPTY,
    GRIPPER,
    HAND,
    NEAR,
    ROBOT_FACTS,
    Condition,
    Kind,
    Primitive,
    condition_of,
    held_by,
    holding,
)
from oag.primitives.cargo import RESTING
from oag.primitives.state import View, assume_true, contradictions
from oag.primitives.table import NAVIGATION, Placement
from oag.rewriting import (
    Variant,
    negated_variants,
    relation_variants,
    rename_object,
    renamed_variants,
    shortened_variants,
)
from oag.task import SimpleTask, infer_roles
from oag.verify.edits import (
    AddFact,
    ChangeSubtask,
    DeleteSubtask,
    InsertSubtask,
    MoveSubtask,
    SetFlow,
    SetTaskGoal,
    SwapSubtasks,
    inserted,
    move_item,
)
from oag.verify.fix_candidates import Candidate, Cost, Mistake, changed_condition, numbered
from oag.wellformed import kind_problem

# Most objects that are tried in place of a wrong one.
_MOST_OBJECTS = 12


def role_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidates that give a subtask other roles, those that its conditions imply first."""
    for rank, index in enumerate(_subtasks_with_wrong_conditions(mistake)):
        subtask = mistake.task.subtasks[index]
        roles = infer_roles(subtask.init, subtask.goal)
        init, goal = subtask.support_init, subtask.support_goal
        changes: list[tuple[int, ChangeSubtask]] = []
        if not roles.problem and roles[:3] != subtask.roles:
            changes.append((0, ChangeSubtask(index, roles.target, roles.support_init or "", roles.support_goal or "")))
        if goal:
            changes.append((1, ChangeSubtask(index, target=goal, support_goal=subtask.target)))
        if init:
            changes.append((1, ChangeSubtask(index, target=init, support_init=subtask.target)))
        if init != goal:
            changes.append((1, ChangeSubtask(index, support_init=goal or "", support_goal=init or "")))
        changes += [(2, ChangeSubtask(index, target=name)) for name in _objects_like(mistake, subtask.target)]
        for later, edit in changes:
            words = _role_words(numbered(index), subtask, edit)
            yield Candidate(Cost.ROLE, "change-role", words, (edit,), index, rank=4 * rank + later)


def object_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidates that name another object throughout a subtask, or in one of its conditions."""
    for rank, index in enumerate(_subtasks_with_wrong_conditions(mistake)):
        subtask = mistake.task.subtasks[index]
        atoms = bddl.atoms(subtask.init) | bddl.atoms(subtask.goal)
        named = dict.fromkeys(subtask.roles)
        named |= dict.fromkeys(sorted(name for atom in atoms for name in atom.args))
        for old in named:
            if old is None or old not in mistake.scene.objects:
                continue
            for new in _objects_like(mistake, old):
                for edit, where in _namings(index, subtask, old, new):
                    words = f"name {new} instead of {old} in {where}"
                    whole = edit.init is not None and edit.goal is not None
                    cost = Cost.ROLE if whole else Cost.CONDITION
                    yield Candidate(cost, "change-object", words, (edit,), index, rank=4 * rank + 3)


def condition_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidates that negate or leave out one literal of a subtask's conditions."""
    for rank, index in enumerate(_subtasks_with_wrong_conditions(mistake)):
        subtask = mistake.task.subtasks[index]
        for field in ("init", "goal"):
            for variant in relation_variants(getattr(subtask, field)):
                yield changed_condition(index, field, variant, 6 * rank)
        for variant in negated_variants(subtask.init):
            # Stating what is the case is the smaller change: a negative literal about another object has no content.
            smaller = rank == 0 and variant.denies
            yield changed_condition(index, "init", variant, *((-1, Cost.ROLE) if smaller else (6 * rank + 4,)))
        # A default task goal would be denied along with the subtask goals.
        for variant in negated_variants(subtask.goal) if mistake.task.goal_given else ():
            yield changed_condition(index, "goal", variant, 6 * rank + 1)
        known = [name for name in subtask.roles if name is not None and name in mistake.scene.objects]
        likely = dict.fromkeys((*known, *_objects_like(mistake, subtask.target)))
        for field in ("init", "goal"):
            before = getattr(subtask, field)
            meant = (
                variant for variant in renamed_variants(before, likely) if _is_of_its_kind(variant, before, mistake)
            )
            for number, variant in enumerate(meant):
                # A negative literal about another object mostly holds, and then has no content.
                rest = 6 * rank + 2 + number // 4 + (6 if variant.denies else 0)
                yield changed_condition(index, field, variant, rest, kind="change-object")
        for variant in shortened_variants(subtask.init):
            yield changed_condition(index, "init", variant, 6 * rank + 20)


def _is_of_its_kind(variant: Variant, before: bddl.Formula, mistake: Mistake) -> bool:
    """Decide whether a changed condition adds no atom that is impossible for a kind: denying one has no effect."""
    return all(kind_problem(atom, mistake.scene) is None for atom in bddl.atoms(variant.formula) - bddl.atoms(before))


def fact_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidate that states a missing fact: a literal that is false only because no fact has it."""
    condition, entry = mistake.condition, mistake.entry
    if condition is None or entry is None or entry.time != 0 or condition.fact in ROBOT_FACTS:
        return
    literal = condition.literal()
    if literal is None or not condition.positive:
        return
    stated = tuple(found for fact in mistake.scene.facts for found in bddl.literals(fact) or ())
    if contradictions((*stated, *(bddl.literals(literal) or ()))) is not None:
        return
    words = f"state {bddl.format(literal)} in the scene's facts"
    yield Candidate(Cost.FACT, "add-fact", words, (AddFact(literal),), assumption=True)


def goal_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidates that change a given task goal, in case it is not what was meant."""
    at_goal = mistake.finding.subtask is None
    if not (at_goal and mistake.task.goal_given):
        return
    goal = mistake.task.goal
    for variant in relation_variants(goal):
        words = f"if that is what was meant, change the task goal from {variant.words}"
        yield Candidate(Cost.TASK_GOAL, "change-task-goal", words, (SetTaskGoal(variant.formula),))
    denied = mistake.condition is not None and not mistake.condition.positive and mistake.condition.fact[0] in RESTING
    # A negative literal about another object or place holds of nearly everything.
    for old in () if denied else sorted({name for atom in bddl.atoms(goal) for name in atom.args}):
        for new in _objects_like(mistake, old):
            words = f"if that is what was meant, name {new} instead of {old} in the task goal"
            edit = SetTaskGoal(rename_object(goal, old, new))
            yield Candidate(Cost.TASK_GOAL, "change-task-goal", words, (edit,), rank=1)


def _role_words(here: str, subtask: SimpleTask, edit: ChangeSubtask) -> str:
    changes = []
    for role in ("target", "support_init", "support_goal"):
        old, new = getattr(subtask, role), getattr(edit, role)
        if new is not None and (new or None) != old:
            changes.append(f"{role} from {old or 'null'} to {new or 'null'}")
    return f"change {here}'s {' and '.join(changes)}"


def _namings(index: int, subtask: SimpleTask, old: str, new: str) -> Iterator[tuple[ChangeSubtask, str]]:
    """Yield the places of a subtask in which one name can be written for another."""
    init, goal = rename_object(subtask.init, old, new), rename_object(subtask.goal, old, new)
    target, before, after = (new if role == old else None for role in subtask.roles)
    here = numbered(index)
    yield ChangeSubtask(index, target, before, after, init, goal), here
    if goal != subtask.goal and after:
        yield ChangeSubtask(index, support_goal=after, goal=goal), f"{here}'s goal and support_goal"
    if init != subtask.init and before:
        yield ChangeSubtask(index, support_init=before, init=init), f"{here}'s init and support_init"


def _subtasks_with_wrong_conditions(mistake: Mistake) -> tuple[int, ...]:
    """Return the subtasks whose roles or conditions may be wrong, the most likely first."""
    count = len(mistake.task.subtasks)
    names = set() if mistake.condition is None else set(mistake.condition.fact[1:])
    if mistake.condition is None and mistake.formula is not None:
        names = _objects_of(mistake.formula, mistake.scene)
    about = [i for i in range(count - 1, -1, -1) if names & {mistake.task.subtasks[i].target}]
    at_goal = about[:2] if mistake.subtask == count else ()
    candidates = (mistake.subtask, mistake.writer, mistake.subtask - 1, *at_goal)
    return tuple(dict.fromkeys(i for i in candidates if i is not None and 0 <= i < count))


def _objects_of(formula: bddl.Formula, scene: Scene) -> set[str]:
    names = {name for atom in bddl.atoms(formula) for name in atom.args}
    ranges = {b.category for node in formula.walk() if isinstance(node, Quantified) for b in node.binders}
    return names | {key for key, thing in scene.objects.items() if thing.category in ranges}


def _objects_like(mistake: Mistake, name: str) -> tuple[str, ...]:
    """Return alternatives to an object: others of its kind, then the rest."""
    objects = mistake.scene.objects
    if name == GRIPPER:
        return ()
    thing = objects.get(name)
    others = [key for key in objects if key != name]
    if thing is not None:
        others.sort(key=lambda key: objects[key].kind is not thing.kind)
    spoken = {name for subtask in mistake.task.subtasks for name in subtask.roles}
    others.sort(key=lambda key: key not in spoken)
    return tuple(others[:_MOST_OBJECTS])


# In longer plans only the subtasks within this many places of a mistake and of its writer are moved.
_SUBTASK_REACH = 6


def order_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidates that put the same subtasks in another order, the nearest places first."""
    near = _near(mistake)
    for first in near:
        for second in near:
            distance, one, other = abs(first - second), _named(mistake, first), _named(mistake, second)
            rank = 2 * distance + (0 if mistake.subtask in (first, second) else 5)
            if first < second:
                swap, words = SwapSubtasks(first, second), f"exchange {one} and {other}"
                yield Candidate(Cost.MOVE, "swap-subtasks", words, (swap,), first, rank=rank)
            if distance > 1:
                words = f"move {one} {'before' if second < first else 'after'} {other}"
                yield Candidate(Cost.MOVE, "move-subtask", words, (MoveSubtask(first, second),), first, rank=rank)


def deletion_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidates that leave a subtask out."""
    for index in _near(mistake):
        words = f"leave out {_named(mistake, index)}"
        rank = 0 if index in (mistake.subtask, mistake.writer) else 1
        yield Candidate(Cost.DELETION, "delete-subtask", words, (DeleteSubtask(index),), index, rank=rank)


def insertion_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidates that insert a subtask for the missing literal, the latest place first."""
    count = len(mistake.task.subtasks)
    latest = min(mistake.subtask, count)
    places = [p for p in range(latest, -1, -1) if latest - p <= 2 * _SUBTASK_REACH or p == 0]
    for parts in dict.fromkeys(part for wanted in _wanted(mistake) for part in _means(mistake, wanted)):
        for place in places:
            edits = tuple(InsertSubtask(place + offset, part) for offset, part in enumerate(parts))
            text = " and then ".join(f'"{_detail_text(part)}"' for part in parts)
            cost = Cost.SUBTASK if len(parts) == 1 else Cost.TWO_SUBTASKS
            words = f"insert {text} {_before(mistake, place)}"
            yield Candidate(cost, "insert-subtask", words, edits, place, rank=latest - place)
        if len(parts) == 1 and parts[0] == opening(parts[0].target):
            yield from _open_and_close(mistake, parts[0], places, latest)


def _open_and_close(mistake: Mistake, part: SimpleTask, places: list[int], latest: int) -> Iterator[Candidate]:
    """Yield the candidates that open a fixture where it is needed and close it afterwards."""
    count = len(mistake.task.subtasks)
    shut = closing(part.target)
    for place in places:
        for end in dict.fromkeys((min(latest + 2, count + 1), count + 1)):
            edits = (InsertSubtask(place, part), InsertSubtask(end, shut))
            where = "at the end" if end == count + 1 else f"before {_named(mistake, end - 1)}"
            words = f'insert "{_detail_text(part)}" {_before(mistake, place)} and "{_detail_text(shut)}" {where}'
            yield Candidate(Cost.TWO_SUBTASKS, "insert-subtask", words, edits, place, rank=latest - place)


def _wanted(mistake: Mistake) -> Iterator[Condition]:
    if mistake.condition is not None:
        yield mistake.condition
        return
    if mistake.obligation is not None:
        for link in mistake.obligation.links:
            yield link.condition._replace(positive=not link.condition.positive)
        return
    if mistake.finding.code == "flow/no-flow" and mistake.subtask < len(mistake.task.subtasks):
        subtask = mistake.task.subtasks[mistake.subtask]
        yield Condition(HAND, holding(subtask.target))
        yield Condition(HAND, EMPTY)
        for fixture in mistake.scene.objects:
            yield Condition(("open", fixture), True)
        for literal in bddl.literals(subtask.goal) or ():
            yield condition_of(literal.atom, literal.value)


def _means(mistake: Mistake, wanted: Condition) -> Iterator[tuple[SimpleTask, ...]]:
    """Yield the simple tasks that make a literal true; some need two, one after the other."""
    fact, objects = wanted.fact, mistake.scene.objects
    if fact[0] == "open" and fact[1] in objects and objects[fact[1]].kind is Kind.ARTICULATED:
        yield (opening(fact[1]),) if wanted.positive else (closing(fact[1]),)
    elif fact == HAND and wanted.positive and wanted.value != EMPTY:
        yield from ((part,) for part in _pickings(mistake, held_by(wanted.value)))
    elif fact == HAND:
        yield from ((part,) for part in _placings(mistake))
    elif fact[0] in RESTING and _is_item(mistake, fact[1]):
        if not wanted.positive:
            yield from ((part,) for part in _pickings(mistake, fact[1]))
        elif fact[2] != GRIPPER:
            put = placing(fact[1], Placement(fact[0], fact[2]))
            yield (put,)
            yield from ((part, put) for part in _pickings(mistake, fact[1]))


def _pickings(mistake: Mistake, item: str | None) -> Iterator[SimpleTask]:
    """Yield the subtasks that pick an item up, from every place where it ever is."""
    if item is None or not _is_item(mistake, item):
        return
    for place in _places_of(mistake, item):
        yield picking(item, place)
    yield picking(item, None)


def _placings(mistake: Mistake) -> Iterator[SimpleTask]:
    """Yield the subtasks that free the hand: at the item's goals, or where it ever was."""
    item = held_by(mistake.entry.value) if mistake.entry is not None else None
    if item is None and mistake.trace is not None:
        item = held_by(mistake.trace.state.hand)
    if item is None:
        return
    goals = (*(subtask.goal for subtask in mistake.task.subtasks), mistake.task.goal)
    aimed = [
        Placement(literal.atom.predicate, literal.atom.args[1])
        for goal in goals
        for literal in bddl.literals(goal) or ()
        if literal.value and literal.atom.predicate in RESTING and literal.atom.args[0] == item
    ]
    for place in dict.fromkeys((*aimed, *_places_of(mistake, item))):
        if place.support in mistake.scene.objects:
            yield placing(item, place)


def _places_of(mistake: Mistake, item: str) -> tuple[Placement, ...]:
    if mistake.trace is None:
        return ()
    facts = [fact for fact, _ in mistake.trace.state.entries() if len(fact) == 3 and fact[0] in RESTING]
    return tuple(
        Placement(fact[0], fact[2])
        for fact in facts
        if fact[1] == item
        and fact[2] in mistake.scene.objects
        and any(entry.value is True for entry in mistake.trace.history(fact))
    )


def _is_item(mistake: Mistake, name: str) -> bool:
    thing = mistake.scene.objects.get(name)
    return thing is not None and thing.kind is Kind.ITEM


def _near(mistake: Mistake) -> list[int]:
    count = len(mistake.task.subtasks)
    around = [mistake.subtask] if mistake.writer is None else [mistake.subtask, mistake.writer]
    return [index for index in range(count) if any(abs(index - place) <= _SUBTASK_REACH for place in around)]


def _detail_text(part: SimpleTask) -> str:
    return part.detail[0].lower() + part.detail[1:-1]


def _named(mistake: Mistake, index: int) -> str:
    return f"{numbered(index)} {mistake.task.subtasks[index].name}"


def _before(mistake: Mistake, place: int) -> str:
    count = len(mistake.task.subtasks)
    if place < count:
        return f"before {numbered(place)}"
    return "at the end" if count else "as the only subtask"


def opening(fixture: str) -> SimpleTask:
    """Return the subtask that opens a fixture."""
    shut = bddl.Not(bddl.Atom("open", (fixture,)))
    return SimpleTask(f"open_{fixture}", f"Open {fixture}.", fixture, None, None, shut, shut.body, _flow(OPEN))


def closing(fixture: str) -> SimpleTask:
    """Return the subtask that closes a fixture."""
    ajar = bddl.Atom("open", (fixture,))
    return SimpleTask(f"close_{fixture}", f"Close {fixture}.", fixture, None, None, ajar, bddl.Not(ajar), _flow(CLOSE))


def picking(item: str, place: Placement | None) -> SimpleTask:
    """Return the subtask that picks an item up from a place, or from wherever it is."""
    name, detail = f"pick_up_{item}", f"Pick up {item}."
    if place is None:
        held = bddl.Atom("inside", (item, GRIPPER))
        return SimpleTask(name, detail, item, None, None, bddl.Not(held), held, _flow(PICK))
    there = bddl.Atom(place.relation, (item, place.support))
    flow = _flow(TAKE_OUT if place.relation == "inside" else PICK)
    return SimpleTask(name, detail, item, place.support, None, there, bddl.Not(there), flow)


def placing(item: str, place: Placement) -> SimpleTask:
    """Return the subtask that puts an item, which the hand holds, where it belongs."""
    held, there = bddl.Atom("inside", (item, GRIPPER)), bddl.Atom(place.relation, (item, place.support))
    words = f"put {item} {'on' if place.relation == 'ontop' else 'inside'} {place.support}"
    name, detail = words.replace(" ", "_"), f"P{words[1:]}."
    return SimpleTask(name, detail, item, None, place.support, held, there, _flow(PLACE))


def _flow(template: PrimitiveFlow) -> ActionFlow:
    return tuple(map(Action, template))


# Primitives with symbolic effects. Purely geometric moves are equivalent to each other, and none is ever missing.
_SYMBOLIC = tuple(Primitive(number) for number in (17, 18, 1, 2, 3, 4, 19, 5, 7, 6))
_MOTION = Primitive.MOVE_BASE_FORWARD
# Steps that are followed to rehearse moves within one flow; flows of fewer than 28 steps are changed anywhere.
_MOST_REHEARSED = 100_000
# Subtasks before the place of a mistake that are changed.
_STEP_REACH = 2
# Largest difference of flows in a ranking, in steps.
_MOST_DIFFERENT = 100


class Rehearsal:
    """The plan followed once more on a window of facts, with the state before every subtask kept.

    A changed flow is tried here first, which takes microseconds; only flows that pass are verified.
    """

    def __init__(self, mistake: Mistake) -> None:
        plan = PlanSearch(mistake.task, mistake.scene)
        self.subtasks, self.legal, self.window = plan.subtasks, plan.legal, plan.start.window
        # The state before every subtask, as if everything had held so far.
        self.before: list[View] = []
        state = plan.start
        for subtask in self.subtasks:
            self.before.append(assume_true(state, subtask.init))
            state = assume_true(force_flow(self.before[-1], subtask), subtask.goal)

    def passes(self, index: int, flow: ActionFlow, *, elsewhere: bool) -> bool:
        """Decide whether a subtask with this flow may reach its goal and let the next one start.

        A flow for a mistake `elsewhere`, which shows in a later subtask, must lead to another state.
        """
        subtask = self.subtasks[index]
        state = run_flow(self.before[index], subtask, flow)
        if state is None or state.truth(subtask.goal) is False:
            return False
        following = self.subtasks[index + 1] if index + 1 < len(self.subtasks) else None
        if elsewhere:
            # What it leaves behind has to differ, poses left out that the next flow brings about itself.
            usual = force_flow(self.before[index], subtask)
            navigates = following is None or bool(following.flow and following.flow[0].primitive in NAVIGATION)
            poses = (NEAR, EEF) if navigates else (EEF,)
            values = zip(self.window.facts, usual.values, state.values, strict=True)
            if not any(before != after for fact, before, after in values if fact not in poses):
                return False
        return following is None or state.truth(following.init) is not False

    def searched(self, index: int) -> PrimitiveFlow | None:
        """Return the first flow that reaches the subtask's goal, or None."""
        try:
            found = flows(self.before[index], self.subtasks[index], self.legal[index])
            return next((each.flow for each in found), None)
        except TooManyStates:
            return None


class _FlowChange(NamedTuple):
    """A changed flow: what was done, at which step, in words."""

    kind: str
    step: int
    words: str
    flow: ActionFlow


def step_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidates that change the flow of the subtask where a mistake shows, or of one shortly before."""
    if mistake.trace is None or not mistake.task.subtasks:
        return
    rehearsal = Rehearsal(mistake)
    for distance, index in enumerate(_subtasks_with_wrong_flow(mistake)):
        flow = mistake.task.subtasks[index].flow
        if flow is None:
            continue
        wanted = rehearsal.searched(index)
        for change in _changes(flow, rehearsal.legal[index], _near_steps(mistake, index, len(flow))):
            if rehearsal.passes(index, change.flow, elsewhere=index != mistake.subtask):
                kind, step, words, changed = change
                edit, text = SetFlow(index, changed, kind, step), words.format(subtask=numbered(index))
                rank = _MOST_DIFFERENT**3 * distance + _difference(changed, flow, wanted)
                yield Candidate(Cost.STEP, kind, text, (edit,), index, step, rank=rank)
        if wanted is not None and wanted != tuple(action.primitive for action in flow):
            searched_flow = tuple(Action(primitive) for primitive in wanted)
            text = " ".join(str(action) for action in searched_flow) or "no steps, since its goal holds already"
            words = f"give {numbered(index)} the flow {text}"
            yield Candidate(Cost.FLOW, "set-flow", words, (SetFlow(index, searched_flow),), index, rank=distance)


def _subtasks_with_wrong_flow(mistake: Mistake) -> tuple[int, ...]:
    """Return the subtasks whose flow may be wrong, the most likely first."""
    last = len(mistake.task.subtasks) - 1
    kind = "" if mistake.obligation is None else mistake.obligation.kind
    here = [mistake.subtask] if kind in ("precondition", "goal") else []
    writer = [] if mistake.writer is None else [mistake.writer]
    if mistake.condition is not None and mistake.condition.fact == HAND:
        # A hand that is full was filled, and not emptied, before.
        here, writer = writer, here
    names = set() if mistake.condition is None else set(mistake.condition.fact[1:])
    latest = min(mistake.subtask, last)
    near = range(latest, max(-1, latest - _STEP_REACH - 1), -1)
    about = [i for i in range(last, -1, -1) if kind == "task-goal" and mistake.task.subtasks[i].target in names]
    return tuple(dict.fromkeys(i for i in (*here, *writer, *about[:2], *near) if i <= latest))


def _near_steps(mistake: Mistake, index: int, length: int) -> range:
    """Return the places in a subtask's flow that are tried: all, but in a very long one those near the mistake.

    Every pair of places is a change to rehearse, and each change is rehearsed over the whole flow.
    """
    reach = isqrt(_MOST_REHEARSED // (length + 1)) // 2
    at = length
    if mistake.obligation is not None and mistake.obligation.subtask == index and mistake.obligation.step >= 0:
        at = mistake.obligation.step
    elif mistake.trace is not None and mistake.entry is not None and mistake.writer == index:
        at = mistake.trace.steps[mistake.entry.time // 2 - 1].position
    return range(max(0, at - reach), min(length, at + reach) + 1)


def _changes(flow: ActionFlow, legal: PrimitiveFlow, places: range) -> Iterator[_FlowChange]:
    primitives = [primitive for primitive in _SYMBOLIC if primitive in legal]
    for step in places:
        for primitive in primitives:
            action = Action(primitive)
            where = f"before step {step + 1} {flow[step].primitive.name}" if step < len(flow) else "at the end"
            words = f"insert {primitive.name} in {{subtask}} {where}"
            yield _FlowChange("insert-step", step, words, inserted(flow, step, action))
    for step, action in zip(places, flow[places.start : places.stop], strict=False):
        name = action.primitive.name
        rest = (*flow[:step], *flow[step + 1 :])
        yield _FlowChange("delete-step", step, f"leave out {{subtask}} step {step + 1} {name}", rest)
        for primitive in primitives:
            if primitive is not action.primitive:
                words = f"replace {{subtask}} step {step + 1} {name} by {primitive.name}"
                yield _FlowChange("replace-step", step, words, inserted(rest, step, Action(primitive)))
        if action.parameter is not None:
            words = f"leave the number of {{subtask}} step {step + 1} {name} to the executor"
            yield _FlowChange("replace-step", step, words, inserted(rest, step, Action(action.primitive)))
        for to in range(places.start, min(len(flow), places.stop)):
            if to not in (step, step - 1):
                words = f"move {{subtask}} step {step + 1} {name} to place {to + 1}"
                yield _FlowChange("move-step", step, words, move_item(flow, step, to))


def _difference(flow: ActionFlow, given: ActionFlow, wanted: PrimitiveFlow | None) -> int:
    """Return the rank of a changed flow: symbolic steps from the right flow, then from the given one, then all steps.

    The last one puts a release after the motions that lead there.
    """
    if wanted is None:
        return 0
    changed, old = [action.primitive for action in flow], [action.primitive for action in given]
    # One motion is as good as another.
    changed, old, right = ([p if p in _SYMBOLIC else _MOTION for p in steps] for steps in (changed, old, wanted))
    symbolic = _edits([p for p in changed if p in _SYMBOLIC], [p for p in right if p in _SYMBOLIC])
    rank = 0
    for difference in (symbolic, _edits(changed, old), _edits(changed, right)):
        rank = rank * _MOST_DIFFERENT + min(difference, _MOST_DIFFERENT - 1)
    return rank


def _edits(left: Sequence[Primitive], right: Sequence[Primitive]) -> int:
    """Return the number of insertions and deletions between two flows."""
    row = list(range(len(right) + 1))
    for count, primitive in enumerate(left, 1):
        above, row = row, [count]
        for position, other in enumerate(right):
            same = above[position] if primitive == other else len(left) + len(right)
            row.append(min(same, above[position + 1] + 1, row[position] + 1))
    return row[-1]
