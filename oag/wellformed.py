"""Well-formedness of a task: names, arities, roles, kinds, parameters and sizes, before anything is progressed.

Source: docs/semantics.md, Verdicts; docs/codes.md, The subtasks and The flows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import bddl
from bddl.ast import Quantified
from bddl.ast import affirmed as affirmed_in
from bddl.grounding import count_ground_parts
from oag.compilation import known_impossible
from oag.model.actions import Action
from oag.model.codec import did_you_mean
from oag.model.diagnostics import SCALES, TASK_GOAL, Diagnostic, Severity
from oag.model.domain import LAST_BUILT_IN, Own, own_of
from oag.model.scene import FREE_PARAMETERS, OWN_NAMES, ROBOT, Scene, SceneObject
from oag.model.symbols import (
    ANY,
    ARTICULATIONS,
    GRIPPER,
    Kind,
    Parameter,
    Primitive,
    applicable,
    has_inside,
    has_rim,
    is_known,
    parameter_problem,
)
from oag.model.where import Where
from oag.primitives.cargo import RESTING
from oag.primitives.state import contradictions
from oag.primitives.table import NAVIGATION, Placement, placement_of
from oag.room import can_be_inside, can_both_be_inside, drifts, stays_near
from oag.sizes import Gripper, farthest_m, scale_factor, too_small
from oag.task_definition import NO_TARGET, SimpleTask, Task, step_place, subtask_place

# A parameter with one of these words in its name, such as `open_fraction`, shapes what opens.
_JOINT_WORDS = frozenset(["door", "doors", "drawer", "drawers", "hinge", "hinges", "joint", "joints", "open"])
# Other places of one mistake that are listed; further ones are only counted.
_SHOWN_PLACES = 3
# Most parts of a task's conditions with every quantifier spelled out; evaluating them takes milliseconds.
MOST_INSTANCES = 10_000
_HANDLING = (Primitive.GRASP, *ARTICULATIONS)


def check(task: Task, scene: Scene) -> tuple[Diagnostic, ...]:
    """Return everything that is wrong with a task's form, each cause once, in order of place.

    The only warning is that the task is too large to be decided.
    """
    found = _Findings(task, scene)
    found.extend(task.issues)
    _check_scene(found)
    for index, subtask in enumerate(task.subtasks):
        found.extend(_placed(task, index, issue) for issue in subtask.issues)
        _check_roles(found, index, subtask)
        if subtask.where is not None:
            _check_where(found, index, subtask, subtask.where)
        for which, formula in (("init", subtask.init), ("goal", subtask.goal)):
            if not found.sound(formula):
                _check_formula(found, formula, index, which)
        _check_flow(found, index, subtask)
        for known in known_impossible(subtask, scene) if scene.known else ():
            if not known.given:
                cause = ("infeasible", known.kind, known.thing, str(known.place))
                found.add("task/infeasible", str(known), subtask_place(task, index), index, cause=cause)
    # A default goal repeats the mistakes of the subtask goals.
    if (task.goal_given or not found) and not found.sound(task.goal):
        _check_formula(found, task.goal, None, "goal")
    _check_scales(found)
    if not found:
        _check_room(found)
    return found.diagnostics()


class _Findings:
    """Diagnostics of a task; a repeated mistake is counted with its first place."""

    def __init__(self, task: Task, scene: Scene) -> None:
        self.task = task
        self.scene = scene
        self.names = dict.fromkeys((*scene.objects, GRIPPER, ROBOT))
        self._found: dict[object, Diagnostic] = {}
        self._repeats: dict[object, list[str]] = {}
        self._sound: set[tuple[str, tuple[str, ...]]] = set()
        # Numbers that are within their primitive's range.
        self.fitting: set[tuple[Primitive, Parameter]] = set()
        # How many parts the conditions with quantifiers have so far, every quantifier spelled out.
        self.instances = 0
        # Where the goal of each subtask wants its target.
        self.placements: list[Placement | None] = []

    def __bool__(self) -> bool:
        return bool(self._found)

    def sound(self, formula: bddl.Formula) -> bool:
        """Decide whether a formula is a conjunction of literals without any mistake.

        Nearly every formula is, and this takes a fraction of the time of naming a mistake.
        """
        literals = bddl.literals(formula)
        if literals is None:
            return False
        for atom, _ in literals:
            known = (atom.predicate, atom.args)
            if known not in self._sound:
                if not self._sound_atom(atom):
                    return False
                self._sound.add(known)
        return contradictions(literals) is None

    def _sound_atom(self, atom: bddl.Atom) -> bool:
        """Decide whether an atom has a known predicate and arguments of the right number and kind."""
        spec = self.scene.domain.predicates.get(atom.predicate)
        if spec is None or spec.arity != len(atom.args):
            return False
        for name, parameter in zip(atom.args, spec.parameters, strict=True):
            if name not in self.names and parameter not in FREE_PARAMETERS:
                return False
        return kind_problem(atom, self.scene) is None

    def extend(self, issues: Iterable[Diagnostic]) -> None:
        """Add findings that were made earlier."""
        for issue in issues:
            self._found[(len(self._found), issue)] = issue

    def add(
        self,
        code: str,
        message: str,
        place: str,
        subtask: int | None,
        *,
        step: int | None = None,
        hint: str | None = None,
        field: str | None = None,
        cause: tuple[str, ...] = (),
        severity: Severity = "error",
    ) -> None:
        """Add one finding; findings with an equal `cause`, a kind of mistake with its object, are one mistake."""
        key: object = cause or len(self._found)
        if key in self._found:
            if place != self._found[key].place:
                self._repeats.setdefault(key, []).append(place)
            return
        about = cause[1:]
        self._found[key] = Diagnostic(
            code, severity, message, place, subtask, step, hint=hint, field=field, about=about
        )

    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """Return the findings, each with the other places where the same mistake stands."""
        for key, places in self._repeats.items():
            others = list(dict.fromkeys(places))
            more = [f"and {len(others) - _SHOWN_PLACES} more"] if len(others) > _SHOWN_PLACES else []
            finding, also = self._found[key], "; ".join(others[:_SHOWN_PLACES] + more)
            self._found[key] = replace(finding, message=f"{finding.message}\nalso in {also}")
        return tuple(self._found.values())

    def add_step(
        self, code: str, message: str, at: tuple[int, int], *, hint: str | None = None, cause: tuple[str, ...] = ()
    ) -> None:
        """Add one finding about a step, given as the indices of its subtask and of itself."""
        self.add(code, message, step_place(self.task, *at), at[0], step=at[1], hint=hint, cause=cause)

    def check_name(self, name: str, place: str, subtask: int | None, field: str | None = None) -> bool:
        """Return whether the scene has an object, and reports it once when it has not."""
        if name in self.names:
            return True
        message = f"the scene {self.scene.name} has no object {name!r}"
        hint = did_you_mean(name, self.names, f"the scene has {', '.join(self.scene.objects) or 'no objects'}")
        self.add("bddl/unknown-object", message, place, subtask, hint=hint, field=field, cause=("object", name))
        return False


def _placed(task: Task, index: int, issue: Diagnostic) -> Diagnostic:
    """Return a mistake found while a subtask was read, with the subtask's present place."""
    return replace(issue, place=", ".join(filter(None, (subtask_place(task, index), issue.place))), subtask=index)


def _check_scene(found: _Findings) -> None:
    """Report scene facts that contradict each other, or that are impossible for a kind."""
    literals = tuple(literal for fact in found.scene.facts for literal in bddl.literals(fact) or ())
    broken, place = contradictions(literals), f"facts of scene {found.scene.name}"
    if broken is not None:
        found.add("task/contradictory", broken, place, None, field="facts")
    for atom, value in literals:
        if value:
            _check_kind(found, atom, None, place, "facts")


def _check_roles(found: _Findings, index: int, subtask: SimpleTask) -> None:
    """Report unknown roles, and roles that do not fit each other or the goal."""
    target, supports, objects = subtask.target, (subtask.support_init, subtask.support_goal), found.scene.objects
    placement = placement_of(subtask.goal, target)
    found.placements.append(placement)
    before, after = supports
    known = target in objects and (before is None or before in objects) and (after is None or after in objects)
    if known and target not in supports and (placement is None or placement.support == supports[1]):
        return
    place = subtask_place(found.task, index)
    roles = tuple(zip(("target", "support_init", "support_goal"), subtask.roles, strict=True))
    for role, name in roles:
        # An unknown target was reported before.
        reported = role == "target" and name == NO_TARGET and subtask.issues
        if name is None or reported or not found.check_name(name, f"{place}, {role}", index):
            continue
        if name in (GRIPPER, ROBOT):
            found.add("task/role-scope", f"{name} cannot be the {role}: it is no object of the scene", place, index)
    for (role, name), formula in zip(roles[1:], (subtask.init, subtask.goal), strict=True):
        # A condition that puts the target onto itself is reported as what it is.
        onto_itself = any(len(atom.args) == 2 and set(atom.args) == {name} for atom in bddl.atoms(formula))
        if name == subtask.target and not onto_itself and found.scene.domain.inherits:
            found.add("task/role-scope", f"{name} is both target and {role}", place, index, cause=("roles", str(index)))
    if placement is None or placement.support in (target, supports[1]) or placement.support not in found.names:
        return
    # A support without an inside is reported as such.
    if kind_problem(bddl.Atom(placement.relation, (ANY, placement.support)), found.scene) is None:
        where = f"{'on' if placement.relation == 'ontop' else placement.relation} {placement.support}"
        message = f"the goal puts {target} {where}, but support_goal is {supports[1] or 'null'}"
        hint = f"set support_goal to {placement.support}"
        found.add("task/role-scope", message, place, index, hint=hint, cause=("roles", str(index)))


def _check_where(found: _Findings, index: int, subtask: SimpleTask, where: Where) -> None:
    """Report a part of what has no such parts, and a spot next to what is not there, or for what is not put down."""
    place, objects = f"{subtask_place(found.task, index)}, where", found.scene.objects
    target, thing = objects.get(subtask.target), objects.get(subtask.support_goal or subtask.target)
    if target is None or thing is None or (where.other and not found.check_name(where.other, place, index)):
        return
    problem = ""
    if where.other:
        if where.other not in objects or where.other in (target.id, thing.id):
            problem = f"{target.id} cannot be put {where}: expected another thing on or in the same place"
        elif target.kind is not Kind.ITEM or subtask.support_goal is None:
            problem = f"{where} is a spot for an item that is put down, and nothing is put down here"
    elif thing.kind is Kind.ITEM or (thing.kind is not Kind.ARTICULATED and where.part != "shelf"):
        problem = f"{thing.id} ({thing.category}) has no {where}: its kind has no such parts"
    if problem:
        found.add("task/role-scope", problem, place, index, cause=("where", str(index)))


def _check_formula(found: _Findings, formula: bddl.Formula, index: int | None, field: str) -> None:
    """Report unknown predicates and objects, wrong arities, wrong kinds and contradictions of one formula."""
    place = TASK_GOAL if index is None else f"{subtask_place(found.task, index)}, {field}"
    binders = [binder for node in formula.walk() if isinstance(node, Quantified) for binder in node.binders]
    for binder in binders:
        _check_category(found, binder.category, index, place, field)
    if binders:
        _check_size(found, formula, index, place, field)
    bound = frozenset(binder.variable for binder in binders)
    impossible = _impossible(found, formula)
    for atom in sorted(bddl.atoms(formula), key=str):
        predicates = found.scene.domain.predicates
        spec = predicates.get(atom.predicate)
        if spec is None:
            message, hint = f"there is no predicate {atom.predicate!r}", did_you_mean(atom.predicate, predicates)
            cause = ("predicate", atom.predicate)
            found.add("bddl/unknown-predicate", message, place, index, hint=hint or None, field=field, cause=cause)
        elif spec.arity != len(atom.args):
            message = f"{atom.predicate} takes {spec.arity} arguments, as in {spec.shape}, got {len(atom.args)}"
            found.add("bddl/arity", message, place, index, field=field)
        else:
            for name, parameter in zip(atom.args, spec.parameters, strict=True):
                if name not in bound and parameter not in FREE_PARAMETERS:
                    found.check_name(name, place, index, field)
            # A formula that puts something inside the robot means the gripper, even if it denies it.
            if atom in impossible or (atom.predicate == "inside" and atom.args[1] == ROBOT):
                _check_kind(found, atom, index, place, field)
    broken = contradictions(bddl.literals(formula) or ())
    # A goal that is read off the subtasks may ask for what cargo undoes: that is decided where the plan ends.
    if broken is not None and (index is not None or found.task.goal_given):
        found.add("task/contradictory", broken, place, index, field=field, cause=("contradictory", broken))


def _check_category(found: _Findings, category: str, index: int | None, place: str, field: str) -> None:
    legal = dict.fromkeys((*(thing.category for thing in found.scene.objects.values()), "object"))
    if category not in legal:
        message = f"the scene {found.scene.name} has no object of category {category!r}"
        hint = did_you_mean(category, legal, f"its categories are {', '.join(legal)}")
        found.add("bddl/unknown-category", message, place, index, hint=hint, field=field, cause=("category", category))


def _check_size(found: _Findings, formula: bddl.Formula, index: int | None, place: str, field: str) -> None:
    """Warn of the condition that makes a task too large to be decided: nested quantifiers multiply."""
    within = found.instances <= MOST_INSTANCES
    found.instances += count_ground_parts(formula, found.scene.categories, MOST_INSTANCES)
    if within and found.instances > MOST_INSTANCES:
        found.add(
            "bddl/too-many-instances",
            f"spelled out over the {len(found.scene.objects)} objects of the scene {found.scene.name}, "
            f"the task's quantifiers say more than {MOST_INSTANCES} things: nothing of the plan was decided",
            place,
            index,
            field=field,
            hint="nest fewer quantifiers, let them range over a narrower category, or name the objects that are meant",
            severity="warning",
        )


def _impossible(found: _Findings, formula: bddl.Formula) -> frozenset[bddl.Atom]:
    """Return the affirmed atoms of the conjuncts that cannot hold because of what kinds exclude.

    An alternative to something possible is no mistake: it is never taken.
    """
    scene = found.scene

    def known(atom: bddl.Atom) -> bool | None:
        return None if kind_problem(atom, scene) is None else False

    def fails(part: bddl.Formula) -> bool:
        if isinstance(part, bddl.Atom) or found.instances > MOST_INSTANCES:
            return True
        excluded = any(known(atom) is False for atom in bddl.atoms(part))
        return excluded and bddl.evaluate(part, known, objects=scene.categories) is False

    return frozenset(atom for part in bddl.conjuncts(formula) if fails(part) for atom in affirmed_in(part))


def _check_kind(found: _Findings, atom: bddl.Atom, index: int | None, place: str, field: str | None) -> None:
    problem = kind_problem(atom, found.scene)
    if problem is not None:
        found.add("bddl/kind", problem.message, place, index, hint=problem.hint, field=field, cause=problem.cause)


class KindProblem(NamedTuple):
    """What an object cannot be by its kind: message, hint, and what distinguishes the mistake."""

    message: str
    hint: str
    cause: tuple[str, str]


def kind_problem(atom: bddl.Atom, scene: Scene) -> KindProblem | None:
    """Decide whether an atom is impossible for a kind: `open` without a joint, or `inside` what has no inside.

    Nothing but `(inside item gripper)` can be said of the gripper, the robot and a ground that is not listed.
    """
    if atom.predicate == "open" and len(atom.args) == 1:
        thing = scene.objects.get(atom.args[0])
        if thing is None and atom.args[0] in OWN_NAMES:
            message = f"{atom.args[0]} cannot be open: it is no object of the scene"
            return KindProblem(message, _openable(scene), ("kind", atom.args[0]))
        if thing is not None and thing.kind is not Kind.ARTICULATED:
            message = f"{thing.id} ({thing.category}) cannot be open: it is no articulated fixture"
            return KindProblem(message, _openable(scene), ("kind", thing.id))
        if thing is not None and not _known_to_open(thing, scene):
            message = f"nothing says that {thing.id} ({thing.category}) opens: its kind is a guess from its size"
            hint = f"if it has a door or a drawer, say so in the scene's facts: (not (open {thing.id}))"
            return KindProblem(message, hint, ("kind", thing.id))
    elif atom.predicate in RESTING and len(atom.args) == 2:
        name, place = atom.args
        thing = scene.objects.get(place)
        if place == ROBOT or (place == GRIPPER and atom.predicate == "ontop"):
            hint = f"the hand is called {GRIPPER}: (inside {name} {GRIPPER})"
            return KindProblem(f"nothing can be {atom.predicate} {place}", hint, (atom.predicate, place))
        if name in OWN_NAMES and name not in scene.objects:
            message = f"{name} cannot be {atom.predicate} {place}: {name} is no object of the scene"
            return KindProblem(message, "", ("kind", name))
        if thing is not None and thing.kind is Kind.FIXED:
            message = f"nothing can be {atom.predicate} {thing.id} ({thing.category}): it is fixed to the room"
            return KindProblem(message, "", ("kind", thing.id))
        if atom.predicate == "inside" and thing is not None and not has_inside(thing.category):
            message = f"nothing can be inside {thing.id} ({thing.category}): it has no inside"
            hint = f"what is on it is (ontop {name} {thing.id})"
            return KindProblem(message, hint, ("inside", thing.id))
    return None


def _known_to_open(thing: SceneObject, scene: Scene) -> bool:
    """Decide whether a category, a parameter of a joint or a fact of the scene says that something opens."""
    if is_known(thing.category) or any(not _JOINT_WORDS.isdisjoint(name.split("_")) for name in thing.parameters):
        return True
    literals = (literal for fact in scene.facts for literal in bddl.literals(fact) or ())
    return any(literal.atom == bddl.Atom("open", (thing.id,)) for literal in literals)


def _openable(scene: Scene) -> str:
    names = [thing.id for thing in scene.objects.values() if thing.kind is Kind.ARTICULATED]
    return f"what opens in this scene: {', '.join(names) or 'nothing'}"


def _check_flow(found: _Findings, index: int, subtask: SimpleTask) -> None:
    """Report parameters out of range, and primitives that cannot act on the subtask's objects."""
    if subtask.flow is None or subtask.issues:
        return
    target = found.scene.objects.get(subtask.target)
    kind = None if target is None else target.kind
    inherits = found.scene.domain.inherits
    for position, action in enumerate(subtask.flow):
        primitive = action.primitive
        if primitive > LAST_BUILT_IN or not inherits:
            _check_own(found, (index, position), subtask, primitive, own_of(primitive))
        if action.parameter is not None and (primitive, action.parameter) not in found.fitting:
            _check_number(found, (index, position), action)
        if primitive is NAVIGATION[1] and subtask.support_goal is None:
            message = "NAVIGATE_TO_SUPPORT goes to support_goal, which is null"
            found.add_step("task/role-scope", message, (index, position), cause=("roles", str(index)))
        if target is None or kind is None or primitive not in _HANDLING:
            continue
        if applicable(primitive, kind):
            if primitive is Primitive.GRASP and kind is Kind.ITEM:
                _check_width(found, (index, position), target)
            continue
        # A target that is its own support was named wrongly, so its kind is no further mistake.
        own_support = target.id in (subtask.support_init, subtask.support_goal)
        cause = ("roles", str(index)) if own_support else ("kind", target.id)
        what, hint = f"{target.id} ({target.category})", None
        message = f"{primitive.name} cannot take {what}: it is furniture"
        if primitive in ARTICULATIONS:
            message, hint = f"{primitive.name} needs a joint, and {what} has none", _openable(found.scene)
        found.add_step("flow/kind", message, (index, position), hint=hint, cause=cause)


def _check_own(
    found: _Findings, at: tuple[int, int], subtask: SimpleTask, primitive: Primitive, own: Own | None
) -> None:
    """Report a primitive of an own domain that cannot act on its objects, and one of the 21 in a domain without."""
    domain = found.scene.domain
    problem: str | None = f"is no primitive of the domain {domain.name}"
    if own is not None:
        things = {key: (thing.category, thing.kind) for key, thing in found.scene.objects.items()}
        problem = domain.problem(own, subtask.target, subtask.support_goal, things)
    if problem is not None:
        hint = f"its primitives are {', '.join(domain.rows)}"
        found.add_step("flow/kind", f"{primitive.name} {problem}", at, hint=hint)


def _check_number(found: _Findings, at: tuple[int, int], action: Action) -> None:
    """Report a number out of range, or a motion of the hand that is longer than the arm allows."""
    problem = parameter_problem(action.primitive, action.parameter)
    if problem is not None:
        found.add_step("flow/parameter", f"{action.primitive.name} {problem}", at)
        return
    longest_m = found.scene.robot.model.longest_motion_m(action.primitive)
    if longest_m is not None and isinstance(action.parameter, float) and action.parameter > longest_m:
        message = f"{action.primitive.name} moves the hand at most {longest_m:g} m with this robot's arm"
        found.add_step("flow/parameter", f"{message}, got {action.parameter:g} m", at)
        return
    found.fitting.add((action.primitive, action.parameter))


def _check_width(found: _Findings, at: tuple[int, int], target: SceneObject) -> None:
    """Report an item without a rim whose smaller horizontal side does not fit the gripper.

    Source: the paper's object size adjustment.
    """
    width_m = min(target.extent_m[:2]) * found.task.scales.get(target.id, 1.0)
    gripper = Gripper.of(found.scene.robot)
    if width_m <= gripper.widest_m or has_rim(target.category):
        return
    factor = scale_factor(target, gripper)
    unfit = too_small(factor)
    message = f"{target.id} is {width_m:.3f} m wide, and the gripper takes at most {gripper.widest_m:.3f} m"
    hint = f"it {unfit}" if unfit else f'scale it, as in "scales": {{"{target.id}": {factor}}}'
    found.add_step("task/size", message, at, hint=hint, cause=("size", target.id))


def _check_scales(found: _Findings) -> None:
    """Report scales of unknown objects, and scales that make an object another thing."""
    for name, factor in found.task.scales.items():
        unfit = too_small(factor)
        if found.check_name(name, SCALES, None) and unfit:
            hint = "name a smaller object, or give it the size that it really has in the scene"
            found.add("task/size", f"{name} {unfit}", SCALES, None, hint=hint, cause=("size", name))


def _check_room(found: _Findings) -> None:
    """Report what sizes and distances exclude: things that do not go in, and a hand that was driven away."""
    contents, near_m = _contents(found.scene), farthest_m(found.scene.robot)
    swing_deg = found.scene.robot.model.swing_deg
    for index, (subtask, placement) in enumerate(zip(found.task.subtasks, found.placements, strict=True)):
        target = found.scene.objects[subtask.target]
        flow = () if subtask.flow is None else subtask.flow
        near, item = stays_near(flow, near_m, swing_deg), target.kind is Kind.ITEM
        if near and not item:
            continue
        if not near:
            _check_drift(found, index, subtask, None if placement is None else placement.support)
        if not item:
            continue
        if subtask.flow is None or any(action.primitive is Primitive.GRASP for action in flow):
            for inside in contents.values():
                inside.pop(target.id, None)
        if placement is not None and placement.relation == "inside" and placement.support in found.scene.objects:
            _check_inside(found, index, target, found.scene.objects[placement.support], contents)


def _contents(scene: Scene) -> dict[str, dict[str, None]]:
    """Return what the scene says to be directly inside its items."""
    resting = [
        literal.atom
        for fact in scene.facts
        for literal in bddl.literals(fact) or ()
        if literal.value and literal.atom.predicate in RESTING and set(literal.atom.args) <= scene.objects.keys()
    ]
    # What is on or in an item is only through that in what the item is in.
    carriers: dict[str, set[bddl.Atom]] = {}
    for atom in resting:
        if scene.objects[atom.args[1]].kind is Kind.ITEM:
            carriers.setdefault(atom.args[0], set()).add(atom)
    contents: dict[str, dict[str, None]] = {}
    for atom in resting:
        if atom.predicate == "inside" and not carriers.get(atom.args[0], set()) - {atom}:
            contents.setdefault(atom.args[1], {})[atom.args[0]] = None
    return contents


def _check_inside(
    found: _Findings, index: int, thing: SceneObject, place: SceneObject, contents: dict[str, dict[str, None]]
) -> None:
    """Report a thing that does not go into a place, or not together with what is in it; without sizes, nothing."""
    if not (thing.has_box and place.has_box):
        return
    vessel = place.kind is Kind.ITEM
    thing_m, place_m = _size_m(found, thing), _size_m(found, place)
    where = subtask_place(found.task, index)
    remedy = f"name something larger than {thing.id}"
    nests = has_rim(thing.category) and has_rim(place.category) and all(map(float.__le__, thing_m, place_m))
    if not nests and not can_be_inside(thing_m, place_m, open_top=place.kind is not Kind.ARTICULATED):
        message = f"{thing.id} does not go into {place.id}: it measures {_cm(thing_m)}, and {place.id} {_cm(place_m)}"
        cause = ("room", thing.id, place.id)
        found.add("task/size", message, where, index, hint=f"{remedy}, or a smaller thing", cause=cause)
        return
    inside = contents.setdefault(place.id, {})
    for other in inside if vessel and not has_rim(thing.category) else ():
        other_m = _size_m(found, found.scene.objects[other])
        if (
            other != thing.id
            and not has_rim(found.scene[other].category)
            and not can_both_be_inside(thing_m, other_m, place_m)
        ):
            message = (
                f"{thing.id} does not go into {place.id} together with {other}: they measure {_cm(thing_m)} and "
                f"{_cm(other_m)}, and {place.id} {_cm(place_m)}"
            )
            cause = ("room", thing.id, place.id)
            found.add("task/size", message, where, index, hint=f"take {other} out before, or {remedy}", cause=cause)
    inside[thing.id] = None


def _size_m(found: _Findings, thing: SceneObject) -> tuple[float, ...]:
    return tuple(side * found.task.scales.get(thing.id, 1.0) for side in thing.extent_m)


def _cm(extent_m: tuple[float, ...]) -> str:
    return " x ".join(f"{100 * side:.3g}" for side in extent_m) + " cm"


def _check_drift(found: _Findings, index: int, subtask: SimpleTask, support: str | None) -> None:
    """Report steps that reach for something that the base was driven or turned away from, by the flow's numbers.

    The base is taken to face what it arrived at, as far as the arm turns on it.
    """
    swing_deg = found.scene.robot.model.swing_deg
    reaching = (Primitive.APPROACH, Primitive.CONVERGE, Primitive.GRASP)
    at = (*reaching, Primitive.UNGRASP) if support is not None else reaching
    for drift in drifts(subtask.flow or (), at):
        primitive = (subtask.flow or ())[drift.step].primitive
        name = support if primitive is Primitive.UNGRASP else subtask.target
        if name is None or name not in found.scene.objects or not found.scene.objects[name].has_box:
            continue
        wide, deep, _ = _size_m(found, found.scene.objects[name])
        most_m = farthest_m(found.scene.robot) + math.hypot(wide, deep)
        moved = f"moved {drift.distance_m:.3g} m" if drift.distance_m > most_m else ""
        turned = f"turned by {drift.turn_deg:.3g} degrees" if drift.turn_deg > swing_deg else ""
        if moved or turned:
            bound = f"{most_m:.3g} m" if moved else f"{swing_deg:g} degrees, as far as the arm turns on the base,"
            message = f"{primitive.name} is out of reach of {name}: the base has {moved or turned} since it arrived"
            hint = f"at most {bound} leave {name} in reach: give smaller numbers, or navigate to it afterwards"
            found.add_step("flow/parameter", f"{message}", (index, drift.step), hint=hint, cause=("drift", str(index)))
