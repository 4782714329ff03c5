"""Candidates for fixes of well-formed plans that change what is stated.

These are roles, objects, conditions, facts of the scene, and the task goal.
"""

from __future__ import annotations

from collections.abc import Iterator

import bddl
from bddl.ast import Quantified
from oag.model.scene import Scene
from oag.model.symbols import (
    GRIPPER,
    ROBOT_FACTS,
)
from oag.primitives.cargo import RESTING
from oag.primitives.state import contradictions
from oag.rewriting import (
    Variant,
    negated_variants,
    relation_variants,
    rename_object,
    renamed_variants,
    shortened_variants,
)
from oag.task_definition import SimpleTask, infer_roles
from oag.verify.edits import (
    AddFact,
    ChangeSubtask,
    SetTaskGoal,
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
    """Yield the candidates that turn a subtask round, or change one literal of its conditions."""
    for rank, index in enumerate(_subtasks_with_wrong_conditions(mistake)):
        subtask = mistake.task.subtasks[index]
        if subtask.support_init is None and subtask.support_goal is None:
            # An opening where a closing is meant, or the reverse.
            words = f"exchange init and goal of {numbered(index)}: init {bddl.format(subtask.goal)}"
            edit = ChangeSubtask(index, init=subtask.goal, goal=subtask.init)
            text = f"{words}, goal {bddl.format(subtask.init)}"
            yield Candidate(Cost.CONDITION, "change-condition", text, (edit,), index, rank=6 * rank)
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
