"""Candidates for fixes of plans that are not well formed.

Names, roles, parameters and texts that cannot be meant as written are replaced by likely ones.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping

import bddl
from oag.flows import TEMPLATES
from oag.model.actions import Action, action_from_json
from oag.model.diagnostics import FlowError
from oag.model.scene import ROBOT
from oag.model.symbols import (
    GRIPPER,
    OPPOSITE,
    Kind,
    ParameterKind,
    Primitive,
    parameter_kind,
    parameter_problem,
)
from oag.primitives.cargo import RESTING
from oag.rewriting import rename_object, replace_atom, shortened_variants
from oag.sizes import Gripper, scale_factor, too_small
from oag.task_definition import Task
from oag.verify.edits import (
    ChangeSubtask,
    Edit,
    SetFlow,
    SetScale,
    SetTaskGoal,
    condition_edit,
    inserted,
)
from oag.verify.fix_candidates import Candidate, Cost, Mistake, changed_condition, numbered
from oag.wellformed import kind_problem

# Most parentheses that may be missing or left over at the end of a text.
_MOST_PARENTHESES = 3
# A literal, in which no other form stands.
_LITERAL = re.compile(r"\([^()]*\)")
# A longer text, or one with more mistakes, was not mistyped; every attempt reads all of it again.
_LONGEST_TEXT, _MOST_MISTAKES = 2_000, 20


def form_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidates for one mistake of form."""
    for generator in _GENERATORS.get(mistake.finding.code, ()):
        yield from generator(mistake)


def _text_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidates that rewrite the text of a condition, where the text is available."""
    index, field = mistake.finding.subtask, mistake.finding.field or "goal"
    text = _as_written(mistake.task, index).get(field)
    tried: set[bddl.Formula] = set()
    for rank, attempt in enumerate(_attempts(text, _roles(mistake.task, index)) if isinstance(text, str) else ()):
        try:
            formula = mistake.scene.domain.formula(attempt)
        except bddl.BDDLError:
            continue
        if formula not in tried:
            tried.add(formula)
            edit: Edit = SetTaskGoal(formula) if index is None else condition_edit(index, field, formula)
            where = "the task goal" if index is None else f"{numbered(index)}'s {field}"
            words = f"write {bddl.format(formula)} as {where}"
            yield Candidate(Cost.FORM, "change-condition", words, (edit,), index, rank=rank)


def _as_written(task: Task, subtask: int | None) -> Mapping[str, object]:
    """Return a subtask as the task's file has it, or the task itself for None; empty when it is not available."""
    source: object = task.source
    if subtask is not None and isinstance(source, Mapping):
        listed = source.get("sub_tasks")
        if isinstance(listed, list | tuple) and subtask < len(listed):
            source = listed[subtask]
        else:
            source = source.get(f"sub_task_{subtask + 1}")
    return source if isinstance(source, Mapping) else {}


def _roles(task: Task, subtask: int | None) -> tuple[str, ...]:
    """Return the names in the roles of a task, those of one subtask first, its supports before its target."""
    roles = [(s.support_init, s.support_goal, s.target) for s in task.subtasks]
    own = () if subtask is None else roles[subtask]
    return tuple(dict.fromkeys(name for part in (own, *roles) for name in part if name))


def _attempts(text: str, names: tuple[str, ...]) -> Iterator[str]:
    """Yield likely intended texts, the likeliest first; `names` may be missing ones."""
    mistakes = bddl.check(text) if len(text) <= _LONGEST_TEXT else ()
    if not 0 < len(mistakes) <= _MOST_MISTAKES:
        return
    for mistake in mistakes:
        if mistake.replacement is not None:
            yield mistake.replacement.applied(text)
            yield mistake.replacement.text
    for mistake in mistakes:
        if mistake.code == "wrong-arity":
            yield from _other_arities(text, _offset(text, mistake), names)
    for count in range(1, _MOST_PARENTHESES + 1):
        yield text + ")" * count
        if text.rstrip().endswith(")" * count):
            yield text.rstrip()[:-count]


def _other_arities(text: str, offset: int, names: tuple[str, ...]) -> Iterator[str]:
    """Yield texts in which the literal at an offset has a name more, or one of its names less."""
    literal = _LITERAL.match(text, max(text.rfind("(", 0, offset + 1), 0))
    if literal is None:
        return
    before, words, after = text[: literal.start()], literal[0][1:-1].split(), text[literal.end() :]
    for name in names:
        yield f"{before}({' '.join((*words, name))}){after}"
    for position in range(len(words) - 1, 0, -1):
        yield f"{before}({' '.join((*words[:position], *words[position + 1 :]))}){after}"


def _offset(text: str, mistake: bddl.Diagnostic) -> int:
    return sum(len(line) + 1 for line in text.split("\n")[: mistake.line - 1]) + mistake.column - 1


def _name_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidates that write a known name for an unknown one, everywhere in the task."""
    known = (*mistake.scene.objects, GRIPPER)
    used = dict.fromkeys(
        name for s in mistake.task.subtasks for name in (*s.roles, *_names(s.init), *_names(s.goal)) if name
    ) | dict.fromkeys((*_names(mistake.task.goal), *mistake.task.scales))
    for old in used:
        if old in known or old not in mistake.finding.about:
            continue
        near = bddl.near_names(old, known)
        for rank, new in enumerate(dict.fromkeys((*near, *mistake.scene.objects))):
            edits = tuple(_renaming(mistake.task, old, new))
            words = f"write {new} instead of {old}"
            yield Candidate(Cost.FORM, "change-object", words, edits, mistake.finding.subtask, rank=rank)


def _renaming(task: Task, old: str, new: str) -> Iterator[Edit]:
    yield from _everywhere(
        task, lambda formula: rename_object(formula, old, new), lambda name, _: new if name == old else None
    )
    if old in task.scales:
        yield from (SetScale(old, None), SetScale(new, task.scales[old]))


def _everywhere(
    task: Task, write: Callable[[bddl.Formula], bddl.Formula], role: Callable[[str | None, bool], str | None]
) -> Iterator[Edit]:
    """Yield the edits that rewrite all conditions of a task.

    `write` returns the replacement of a formula; `role` that of a role's name, given whether the condition that names
    it changes, and None to keep it.
    """
    for index, subtask in enumerate(task.subtasks):
        init, goal = (other if (other := write(old)) != old else None for old in (subtask.init, subtask.goal))
        before, after = role(subtask.support_init, init is not None), role(subtask.support_goal, goal is not None)
        edit = ChangeSubtask(index, role(subtask.target, False), before, after, init, goal)
        if edit != ChangeSubtask(index):
            yield edit
    if task.goal_given and write(task.goal) != task.goal:
        yield SetTaskGoal(write(task.goal))


def _names(formula: bddl.Formula) -> tuple[str, ...]:
    return tuple(name for atom in sorted(bddl.atoms(formula), key=str) for name in atom.args if name[:1] != "?")


def _contradiction_candidates(mistake: Mistake) -> Iterator[Candidate]:
    index = mistake.finding.subtask
    if index is None:
        for variant in shortened_variants(mistake.task.goal):
            words = f"leave {variant.words} out of the task goal"
            yield Candidate(Cost.FORM, "change-task-goal", words, (SetTaskGoal(variant.formula),))
        return
    for field in ("init", "goal"):
        for variant in shortened_variants(getattr(mistake.task.subtasks[index], field)):
            yield changed_condition(index, field, variant, 0, Cost.FORM)


def _size_candidates(mistake: Mistake) -> Iterator[Candidate]:
    if mistake.finding.subtask is None:
        return
    name = mistake.task.subtasks[mistake.finding.subtask].target
    factor = scale_factor(mistake.scene.objects[name], Gripper.of(mistake.scene.robot))
    if too_small(factor) is None:
        width_m = factor * min(mistake.scene.objects[name].extent_m[:2])
        words = f"scale {name} by {factor:g}, to a width of {width_m:.3f} m"
        yield Candidate(Cost.FORM, "change-scale", words, (SetScale(name, factor),))


def _flow_candidates(mistake: Mistake) -> Iterator[Candidate]:
    index, step = mistake.finding.subtask, mistake.finding.step
    if index is None or step is None:
        return
    flow = mistake.task.subtasks[index].flow or ()
    here = f"{numbered(index)} step {step + 1}"
    if mistake.finding.code == "flow/unknown-primitive":
        for rank, action in enumerate(_meant(mistake, index, step)):
            edit = SetFlow(index, inserted(flow, step, action), "replace-step", step)
            words = f"write {int(action.primitive)} {action} as {here}"
            yield Candidate(Cost.FORM, "replace-step", words, (edit,), index, step, rank=rank)
    elif step < len(flow):
        for action in _in_range(flow[step]):
            edit = SetFlow(index, (*flow[:step], action, *flow[step + 1 :]), "replace-step", step)
            words = f"write {action} as {here}" + (", its number left to the executor" if action.unfilled else "")
            yield Candidate(Cost.FORM, "replace-step", words, (edit,), index, step)
        rest = (*flow[:step], *flow[step + 1 :])
        words = f"leave out {here} {flow[step].primitive.name}"
        edit = SetFlow(index, rest, "delete-step", step)
        yield Candidate(Cost.STEP, "delete-step", words, (edit,), index, step, rank=50)
    for rank, template in enumerate(TEMPLATES):
        edit = SetFlow(index, tuple(Action(primitive) for primitive in template))
        words = f"give {numbered(index)} the flow {' '.join(primitive.name for primitive in template)}"
        yield Candidate(Cost.FLOW, "set-flow", words, (edit,), index, rank=rank)


def _meant(mistake: Mistake, index: int, step: int) -> Iterator[Action]:
    """Yield likely meanings of an unknown primitive, near names first; with a number, those that take it."""
    flow = _as_written(mistake.task, index).get("flow")
    written = flow[step] if isinstance(flow, list) and step < len(flow) else None
    value = next(iter(written.values()), None) if isinstance(written, dict) else None
    for primitive in dict.fromkeys((*map(Primitive, mistake.finding.meant), *Primitive)):
        try:
            action = action_from_json({str(int(primitive)): value})
        except FlowError:
            continue
        if parameter_problem(primitive, action.parameter) is None:
            yield action


def _in_range(action: Action) -> Iterator[Action]:
    value = action.parameter
    others = []
    if isinstance(value, float) and value < 0.0 and action.primitive in OPPOSITE:
        others.append(Action(OPPOSITE[action.primitive], -value))
    if isinstance(value, tuple) and parameter_kind(action.primitive) is ParameterKind.JOINT_LIMITS:
        others.append(Action(action.primitive, (min(value), max(value))))
    yield from (other for other in others if parameter_problem(other.primitive, other.parameter) is None)
    if value is not None:
        yield Action(action.primitive)


def _articulated_candidates(mistake: Mistake) -> Iterator[Candidate]:
    index = mistake.finding.subtask
    if index is None:
        return
    subtask = mistake.task.subtasks[index]
    for old in dict.fromkeys((subtask.target, *_names(subtask.init), *_names(subtask.goal))):
        for new, thing in mistake.scene.objects.items():
            if thing.kind is Kind.ARTICULATED and old != new:
                words = f"name {new} instead of {old} in {numbered(index)}"
                target = new if subtask.target == old else None
                init, goal = rename_object(subtask.init, old, new), rename_object(subtask.goal, old, new)
                edit = ChangeSubtask(index, target=target, init=init, goal=goal)
                yield Candidate(Cost.ROLE, "change-object", words, (edit,), index)


def _inside_candidates(mistake: Mistake) -> Iterator[Candidate]:
    """Yield the candidates that replace an impossible place: on the object, in another one, or in the hand."""
    task, scene, index = mistake.task, mistake.scene, mistake.finding.subtask
    formulas = (task.goal,) if index is None else (task.subtasks[index].init, task.subtasks[index].goal)
    all_atoms = (atom for formula in formulas for atom in sorted(bddl.atoms(formula), key=str))
    for atom in dict.fromkeys(atom for atom in all_atoms if atom.predicate in RESTING):
        if kind_problem(atom, scene) is None:
            continue
        item, place = atom.args
        others = [bddl.Atom("inside", (item, name)) for name in scene.objects if name != item]
        meant = bddl.Atom("inside", (item, GRIPPER)) if place in (ROBOT, GRIPPER) else bddl.Atom("ontop", atom.args)
        for rank, other in enumerate(other for other in (meant, *others) if kind_problem(other, scene) is None):
            words = f"write {bddl.format(other)} instead of {bddl.format(atom)}"
            edits = tuple(_rewriting(task, atom, other))
            yield Candidate(Cost.FORM, "change-condition", words, edits, index, rank=rank)


def _rewriting(task: Task, old: bddl.Atom, new: bddl.Atom) -> Iterator[Edit]:
    support = None if new.args[1] == GRIPPER else new.args[1]
    return _everywhere(
        task,
        lambda formula: replace_atom(formula, old, new),
        lambda name, changed: support if changed and name == old.args[1] else None,
    )


_GENERATORS: Mapping[str, tuple[Callable[[Mistake], Iterator[Candidate]], ...]] = {
    "bddl/syntax": (_text_candidates,),
    "bddl/arity": (_text_candidates,),
    "bddl/unknown-predicate": (_text_candidates,),
    "bddl/unknown-category": (_text_candidates,),
    "bddl/unknown-object": (_text_candidates, _name_candidates),
    "bddl/kind": (_inside_candidates, _articulated_candidates),
    "task/contradictory": (_contradiction_candidates,),
    "task/size": (_size_candidates,),
    "flow/parameter": (_flow_candidates,),
    "flow/unknown-primitive": (_flow_candidates,),
    "flow/kind": (_flow_candidates, _articulated_candidates),
}
