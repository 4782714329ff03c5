"""Diagnostics of a followed plan, in the order of reports: failures, assumptions, locality, and notes.

Root failures and assumptions are explained in words: what is needed, what is the case instead, and which step wrote it.

Source: docs/codes.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from operator import itemgetter
from typing import NamedTuple

import bddl
from bddl.ast import Quantified
from oag.compilation import compile_plan, known_impossible, literals_in
from oag.flows import NoFlow, no_flow_finding, searched_notes
from oag.model.diagnostics import SCALES, TASK_GOAL, WRONG_ORDER, Diagnostic
from oag.model.infeasible import Infeasible
from oag.model.scene import Scene
from oag.model.symbols import (
    EEF,
    EMPTY,
    HAND,
    NEAR,
    ROBOT_FACTS,
    Condition,
    Fact,
    Kind,
    Primitive,
    Value,
    condition_of,
    conjunction,
    fact_text,
    generalisations,
    held_by,
    holding,
    satisfying_value,
)
from oag.primitives.cargo import RESTING
from oag.primitives.state import START, scene_facts, truth_of
from oag.primitives.table import clauses_of, guarded, needed
from oag.progression import (
    Assumption,
    CausalLink,
    Obligation,
    RootFailure,
    Step,
    Trace,
    producer_place,
)
from oag.sizes import planned_resizings
from oag.task_definition import Task, default_goal, is_meant_to_change, label, step_place, subtask_place


def needed_text(condition: Condition | None, formula: bddl.Formula | None) -> str | None:
    """Return a needed literal, or a formula beyond literals, in words."""
    if condition is not None:
        return condition.text()
    return None if formula is None else bddl.format(formula)


def state_text(condition: Condition, value: Value) -> str:
    """Return the actual state, where a condition does not hold."""
    fact = condition.fact
    if fact == HAND:
        item = held_by(value)
        if item is not None:
            return f"the hand holds {item}"
        return "the hand is empty" if value == EMPTY else f"the hand grips {str(value).partition(' ')[2]}"
    if fact == NEAR:
        return f"the robot is at {value}"
    if fact == EEF:
        return f"the arm is {value}"
    return "it is true" if value is True else "it is false"


def verb(condition: Condition) -> str:
    """Return what a step would have to do, such as `opens it`."""
    fact, value = condition.fact, condition.value
    if fact == NEAR:
        return f"navigates to {value}"
    if fact == EEF:
        position, _, target = str(value).partition(" ")
        return f"{'approaches' if position == 'before' else 'converges on'} {target}"
    if fact == HAND:
        action, _, target = str(value).partition(" ")
        if not condition.positive:
            return "lets go of it"
        return "lets go" if value == EMPTY else f"{'grasps' if action == 'holding' else 'grips'} {target}"
    if fact[0] == "open":
        return "opens it" if condition.positive else "closes it"
    if fact[0] in RESTING:
        return "puts it there" if condition.positive else "takes it away"
    return "makes it true" if condition.positive else "makes it false"


def why_false(trace: Trace, obligation: Obligation, formula: bddl.Formula | None, objects: dict[str, str]) -> str:
    """Return why a formula is false; conjuncts that hold are not named."""
    if obligation.cases is not None:
        text = _links_text(trace, obligation.links)
        return f"it is false in every state in which the plan gets here{f', with {text}' if text else ''}"
    conjuncts = () if formula is None else bddl.conjuncts(formula)
    reasons = [(part, read) for part in conjuncts if (read := _falsified_by(part, obligation.links, objects))]
    if len(conjuncts) < 2 or not reasons:
        text = _links_text(trace, obligation.links)
        return f"it is false: {text}" if text else "it is false in every state"
    return "\n".join(f"{bddl.format(part)} is false: {_links_text(trace, read)}" for part, read in reasons)


def _falsified_by(part: bddl.Formula, links: tuple[CausalLink, ...], objects: dict[str, str]) -> tuple[CausalLink, ...]:
    """Return the facts that make a formula false; none when it is not known to be false."""
    known = {(link.condition.fact, link.condition.value): link for link in links}
    read: dict[bddl.Atom, CausalLink] = {}

    def value(atom: bddl.Atom) -> bool | None:
        condition = condition_of(atom, True)
        link = known.get((condition.fact, condition.value))
        if link is None:
            return None
        read[atom] = link
        return link.condition.positive

    return tuple(read.values()) if bddl.evaluate(part, value, objects=objects) is False else ()


def _links_text(trace: Trace, links: tuple[CausalLink, ...]) -> str:
    return ", ".join(f"{link.condition.text()} since {_since(trace, link)}" for link in links)


def _since(trace: Trace, link: CausalLink) -> str:
    if link.value is None:
        return producer_place(trace, link.producer)
    return producer_place(trace, trace.since(link.condition.fact, link.value, link.producer).time)


# Most facts of the start that are named for a formula over many objects.
_SHOWN_FACTS = 8


class Explainer:
    """Diagnostics of one trace."""

    def __init__(self, task: Task, scene: Scene, trace: Trace) -> None:
        self.task = task
        self.scene = scene
        self.trace = trace

    def failures(self) -> Iterator[Diagnostic]:
        """Yield one error for each root cause, in order."""
        for failure, dependent in zip(self.trace.failures, self.trace.dependents, strict=True):
            yield self._failure(failure, dependent)

    def assumptions(self) -> Iterator[Diagnostic]:
        """Yield one warning for each thing that is needed and unknown, in order."""
        for assumption in self.trace.assumptions:
            obligation = self.trace.obligations[assumption.obligation]
            why = "it held, but carrying something made it unknown"
            if assumption.condition is None:
                why = "what is known does not decide it"
            elif assumption.about_start:
                why = "nothing states it, and no step before decides it"
            yield Diagnostic(
                "context/open",
                "warning",
                why + self._otherwise(assumption.condition, obligation, possible=True),
                self._place(obligation),
                *self._indices(obligation),
                literal=needed_text(assumption.condition, assumption.formula),
                hint=self._closing_hint(assumption),
            )

    def goal_gaps(self) -> Iterator[Diagnostic]:
        """Yield one note for each subtask whose goal omits what the rest of the plan needs of its flow.

        Source: docs/codes.md, context/goal-gap: such a boundary holds by the flow, but not by the goal.
        """
        gaps: dict[int, dict[Condition, Obligation]] = {}
        steps = self.trace.steps
        for obligation in self.trace.obligations:
            subtask = obligation.subtask
            for condition, producer, _ in obligation.links:
                if producer <= 0 or producer % 2:
                    continue
                made_by = steps[producer // 2 - 1].subtask
                if made_by < subtask and condition.sayable:
                    goal = needed(self.task.subtasks[made_by].goal)
                    if not (isinstance(goal, tuple) and (condition,) in goal):
                        gaps.setdefault(made_by, {}).setdefault(condition, obligation)
        for index, gap in sorted(gaps.items(), key=itemgetter(0)):
            needs = "; ".join(f"{c.text()} for {o.place}" for c, o in gap.items())
            stated_goal = self.task.subtasks[index].goal
            message = f"the goal {bddl.format(stated_goal)} can hold without what the rest of the plan needs: {needs}"
            hint = f"accept the subtask on {bddl.format(conjunction(stated_goal, gap))}"
            yield Diagnostic("context/goal-gap", "note", message, subtask_place(self.task, index), index, hint=hint)

    def _failure(self, failure: RootFailure, dependent: int) -> Diagnostic:
        obligation = self.trace.obligations[failure.obligation]
        code, label_text = self._code(obligation, failure)
        since = None
        known = self._known(obligation, failure)
        if known is not None:
            code, label_text, message = "task/infeasible", None, str(known)
        elif failure.condition is not None:
            value = False if failure.entry.value is None else failure.entry.value
            began = self.trace.since(failure.condition.fact, value, failure.entry.time)
            since = producer_place(self.trace, began.time)
            message = self._why(failure, failure.condition, obligation, began.time, since)
        else:
            message = why_false(self.trace, obligation, failure.formula, self.scene.categories)
        return Diagnostic(
            code,
            "error",
            message,
            self._place(obligation),
            *self._indices(obligation),
            literal=needed_text(failure.condition, failure.formula),
            since=since,
            start=self._start(failure),
            stops_at=obligation.place,
            eai_label=label_text,
            dependent=dependent,
        )

    def _known(self, obligation: Obligation, failure: RootFailure) -> Infeasible | None:
        """Return what geometry found impossible, and is asked for again in the same circumstances."""
        if obligation.kind != "init" or not self.scene.known:
            return None
        subtask, links, objects = self.task.subtasks[obligation.subtask], obligation.links, self.scene.categories
        if failure.condition is None and _falsified_by(subtask.init, links, objects):
            return None
        for each in known_impossible(subtask, self.scene):
            given = [clauses_of(literals_in(each.given))]
            denied, formula = guarded((), given), guarded(bddl.And(()), given)
            if isinstance(denied, tuple) and any(failure.condition in clause for clause in denied):
                return each
            if failure.condition is None and isinstance(formula, bddl.And) and _falsified_by(formula, links, objects):
                return each
        return None

    def _code(self, obligation: Obligation, failure: RootFailure) -> tuple[str, str | None]:
        if obligation.kind == "init":
            code = "context/start" if obligation.subtask == 0 else "context/refuted"
        elif obligation.kind == "goal":
            code = "flow/goal-not-reached"
        elif obligation.kind == "precondition":
            code = "flow/precondition"
        else:
            code = "goal/undone" if self._reached_before(failure) else "goal/not-reached"
        if code in ("flow/precondition", "context/refuted") and self._held_before(failure):
            return code, WRONG_ORDER
        return code, None

    def _reached_before(self, failure: RootFailure) -> bool:
        return any(
            link.condition == failure.condition
            for obligation in self.trace.obligations[: failure.obligation]
            if obligation.kind == "goal"
            for link in obligation.links
        )

    def _held_before(self, failure: RootFailure) -> bool:
        condition = failure.condition
        if condition is None or condition.fact in (NEAR, EEF):
            return False
        history = self.trace.history(condition.fact)
        return any(condition.grade(entry.value) for entry in history if entry.time < failure.entry.time)

    def _why(self, failure: RootFailure, condition: Condition, obligation: Obligation, began: int, since: str) -> str:
        """Return what is the case instead, since when, and that nothing changed it."""
        instead = state_text(condition, failure.entry.value)
        lines = [f"{instead} since {since}; {self._nothing(condition, obligation, began)}"]
        if condition.fact[0] in RESTING and not condition.positive and obligation.kind == "goal":
            lines.append(self._why_resting(condition.fact, obligation.subtask))
        later = self._made_later(condition, obligation)
        if later is not None:
            lines.append(f"{later} would, but comes later")
        otherwise = self._otherwise(condition, obligation, possible=False).strip()
        if otherwise:
            lines.append(f"{otherwise}, which is not so either")
        if len(failure.missing) > 1:
            others = ", ".join(other.text() for other in failure.missing if other != condition)
            lines.append(f"the same place also lacks {others}")
        return "\n".join(lines)

    def _nothing(self, condition: Condition, obligation: Obligation, began: int) -> str:
        """Return the clause that no step in between made the literal true."""
        does = verb(condition)
        if began > 0 and began % 2 == 0:
            return f"no step after that {does}"
        reached = min(obligation.subtask, len(self.task.subtasks) - 1) + 1
        if obligation.kind == "init":
            reached = obligation.subtask
        if reached == 0:
            return "no step comes before"
        return f"no step of {'T1' if reached == 1 else f'T1-T{reached}'} {does}"

    def _why_resting(self, fact: Fact, subtask: int) -> str:
        """Return why an item that a subtask should have taken away still rests where it was."""
        _, item, place = fact
        steps = [step for step in self.trace.steps if step.subtask == subtask]
        grasped = any((HAND, holding(item)) in step.effect or held_by(step.hand) == item for step in steps)
        if not grasped:
            return f"nothing in T{subtask + 1} grasps {item}"
        within = fact[0] == "inside" and place in self.scene.objects and self.scene[place].kind is not Kind.ITEM
        motion = "RETREAT or driving" if within else "a motion"
        example = "" if within else ", such as LIFT_EEF_UP"
        return f"T{subtask + 1} grasps {item}, but {motion} has to follow while it is held{example}"

    def _made_later(self, condition: Condition, obligation: Obligation) -> str | None:
        """Return the first step of a later subtask that writes what an earlier place lacks."""
        if obligation.kind in ("goal", "task-goal") or condition.fact in (NEAR, EEF):
            return None
        wanted = (condition.fact, condition.value if condition.positive else False)
        for step in self.trace.steps:
            if step.subtask > obligation.subtask and wanted in step.effect:
                return f"T{step.subtask + 1} step {step.position + 1} {step.primitive.name}"
        return None

    def _otherwise(self, condition: Condition | None, obligation: Obligation, *, possible: bool) -> str:
        """Return a line with the alternatives on which a step would run too.

        If they are `possible`, those that may hold there are named, and of the others it is said that they cannot.
        """
        others = self.alternatives(condition, obligation)
        out = [other for other, may_be in others.items() if possible and not may_be]
        lines = [f"{other.text()} would do, and is known not to be so" for other in out]
        left = " or ".join(other.text() for other in others if other not in out)
        if left:
            lines.insert(0, f"{self.trace.steps[obligation.time // 2].primitive.name} would also run with {left}")
        return "".join(f"\n{line}" for line in lines)

    def alternatives(self, condition: Condition | None, obligation: Obligation) -> dict[Condition, bool]:
        """Return the alternatives to a condition on which a step would run, each with whether it may hold there."""
        if condition is None or obligation.kind != "precondition":
            return {}
        rows = compile_plan(self.task.subtasks, self.scene)[obligation.subtask].rows
        step = self.trace.steps[obligation.time // 2]
        clauses = rows.row(step.primitive, step.hand)[0]
        others = next((clause for clause in clauses if condition in clause), ())
        return {other: not self._known_false(other, obligation) for other in others if other != condition}

    def _known_false(self, condition: Condition, obligation: Obligation) -> bool:
        written = [e.value for e in self.trace.history(condition.fact) if e.time <= obligation.time]
        value = satisfying_value(condition)
        if not written and isinstance(value, bool):
            return self.trace.starts.exclude(condition.fact, value, {})
        return condition.grade([None, *written][-1]) is False

    def _closing_hint(self, assumption: Assumption) -> str | None:
        """Return how the scene could settle an unknown literal."""
        condition = assumption.condition
        literal = None if condition is None else condition.literal()
        if condition is None or literal is None or not assumption.about_start:
            return None
        closed = f', or list "{condition.fact[0]}" under "closed"' if not condition.positive else ""
        return f'state {bddl.format(literal)} in the scene\'s "facts"{closed} if it holds'

    def _start(self, failure: RootFailure) -> tuple[str, ...]:
        """Return literals of a start state from which the plan fails here, the ones about the task's objects."""
        names = {name for subtask in self.task.subtasks for name in subtask.roles}
        texts: dict[str, None] = {}
        for fact in self.scene.facts:
            for literal in bddl.literals(fact) or ():
                if names.issuperset(literal.atom.args[:1]):
                    text = f"{literal.atom.predicate}({', '.join(literal.atom.args)})"
                    texts[text if literal.value else f"not {text}"] = None
        condition = failure.condition
        if condition is None:
            # Facts of the start that make a formula false, the first few.
            links = self.trace.obligations[failure.obligation].links
            start = [link for link in links if link.producer <= 0 and link.condition.fact not in ROBOT_FACTS]
            texts |= dict.fromkeys(link.condition.text() for link in start[:_SHOWN_FACTS])
        elif failure.entry.time == 0 and condition.fact not in (NEAR, EEF, HAND):
            texts[fact_text(condition.fact, failure.entry.value)] = None
        for assumption in self.trace.assumptions:
            if assumption.obligation < failure.obligation and assumption.condition is not None:
                texts[assumption.condition.text()] = None
        texts[fact_text(HAND, self.trace.start.hand)] = None
        return tuple(texts)

    def _indices(self, obligation: Obligation) -> tuple[int | None, int | None]:
        subtask = None if obligation.kind == "task-goal" else obligation.subtask
        return subtask, obligation.step if obligation.kind == "precondition" else None

    def _place(self, obligation: Obligation) -> str:
        if obligation.kind == "task-goal":
            return TASK_GOAL
        if obligation.kind == "precondition":
            return step_place(self.task, obligation.subtask, obligation.step)
        return f"{subtask_place(self.task, obligation.subtask)}, {obligation.kind}"


def all_findings(
    task: Task, scene: Scene, trace: Trace, proof: NoFlow | None, searched: tuple[int, ...]
) -> tuple[Diagnostic, ...]:
    """Return the diagnostics of a well-formed plan: errors first, then warnings, then notes.

    `searched` has the indices of the subtasks whose flow was searched; `proof` shows that a subtask has none.
    """
    explainer = Explainer(task, scene, trace)
    found = [*explainer.failures(), *explainer.assumptions(), *no_flow_finding(task, trace, proof)]
    if trace.unsettled is not None:
        message = f"this was not decided exactly ({trace.unsettled}): the plan may be better or worse than is said here"
        hint = "state more of the scene's facts, or say the conditions in fewer alternatives"
        found.append(_warning("context/undecided", message, "task", hint=hint))
    if not task.subtasks:
        message, hint = "there are no subtasks: the verdict is about doing nothing", 'list them under "sub_tasks"'
        found.append(_warning("task/empty", message, "task", hint=hint))
    runs = not trace.failures and proof is None
    # The place may hold already where the spot in it does not.
    for index in (k for k in trace.vacuous if task.subtasks[k].where is None) if runs else ():
        message = f"its goal {bddl.format(task.subtasks[index].goal)} holds already when it starts"
        hint = "drop the subtask, or say what it has to change"
        found.append(_warning("task/vacuous", message, subtask_place(task, index), index, hint=hint))
    if runs and trace.undecided_from is None:
        found.extend(_holds_at_start(task, scene, trace))
    found.extend(locality_findings(task, scene, trace, runs=runs))
    if runs:
        found.extend(explainer.goal_gaps())
        found.extend(_omitted_effects(task, trace))
    found.extend(searched_notes(task, searched))
    found.extend(_unfilled(task))
    found.extend(
        Diagnostic("task/scaled", "note", str(change), SCALES) for change in planned_resizings(task.scales, scene)
    )
    return tuple(found)


def _holds_at_start(task: Task, scene: Scene, trace: Trace) -> Iterator[Diagnostic]:
    """Yield a warning where the task goal holds before anything moved: a rollout that does nothing would succeed."""
    goal = needed(task.goal)
    if task.subtasks and goal != () and truth_of(goal, trace.start.value, scene.categories):
        message = (
            f"the task goal {bddl.format(task.goal)} holds at the start already: a robot that does nothing reaches it"
        )
        hint = "say in the goal what the subtasks have to change"
        yield _warning("goal/holds-at-start", message, TASK_GOAL, hint=hint)


def _omitted_effects(task: Task, trace: Trace) -> Iterator[Diagnostic]:
    """Yield a note for intended effects of subtasks that the task goal does not mention.

    The goal covers an item if it mentions any place of it, and a door if it mentions its state.
    """
    if not task.goal_given or trace.undecided_from is not None or trace.unsettled is not None:
        return
    spoken = {(atom.predicate in RESTING, atom.args[:1]) for atom in bddl.atoms(task.goal)}
    bound = {binder.variable for node in task.goal.walk() if isinstance(node, Quantified) for binder in node.binders}
    of_any = {is_place for is_place, args in spoken if bound.intersection(args)}
    effects = [
        literal
        for part in bddl.conjuncts(default_goal(task.subtasks))
        for literal in bddl.literals(part) or ()
        if trace.start.holds(literal.atom) is not literal.value
    ]
    placed = {atom.args[:1] for atom, wanted in effects if wanted and atom.predicate in RESTING}
    omitted = []
    for atom, wanted in effects:
        is_place = atom.predicate in RESTING
        # The place where an item is put covers the place from which it was taken.
        if not wanted and is_place and atom.args[:1] in placed:
            continue
        if is_place not in of_any and (is_place, atom.args[:1]) not in spoken:
            omitted.append(bddl.format(atom if wanted else bddl.Not(atom)))
    if omitted:
        holds = f"{', '.join(omitted)} {'holds' if len(omitted) == 1 else 'hold'}"
        message = f"{holds} at the end, as the subtasks want it, and the task goal says nothing of it"
        hint = "add to the goal what is wanted; a rollout that loses it counts as a success"
        yield Diagnostic("goal/omits-effect", "note", message, TASK_GOAL, hint=hint)


def _unfilled(task: Task) -> Iterator[Diagnostic]:
    steps = [
        f"{label(index, position)} {action.primitive.name}"
        for index, subtask in enumerate(task.subtasks)
        for position, action in enumerate(subtask.flow or ())
        if action.unfilled
    ]
    if steps:
        message = f"the executor's geometric planner fills in the numbers of {', '.join(steps)}"
        yield Diagnostic("flow/unfilled", "note", message, "task")


def locality_findings(task: Task, scene: Scene, trace: Trace, *, runs: bool) -> Iterator[Diagnostic]:
    """Yield warnings for changes outside a subtask's scope, and a note for cargo of a grasped item.

    A subtask may change facts about its target and support. Undoing another subtask's goal, without being meant to, is
    clobbering. Changing other facts of the scene is outside the scope. In a plan that cannot succeed (`runs` is False),
    the failure already names the step that undid it.

    Source: docs/codes.md, Locality; the paper asks a subtask to preserve the irrelevant parts of the scene.
    """
    if runs:
        yield from _changes(task, scene, trace)
    yield from _cargo(task, scene, trace)


def _cargo(task: Task, scene: Scene, trace: Trace) -> Iterator[Diagnostic]:
    """Yield a note for each item that is grasped while something is known to rest on or in it."""
    state = trace.start
    # Support -> what was ever put on or in it, in order.
    put: dict[str, dict[Fact, None]] = {}
    for time, effect in ((START, scene_facts(scene)), *trace.writes):
        step = trace.steps[time // 2 - 1] if time > START and time % 2 == 0 else None
        item = None if step is None else task.subtasks[step.subtask].target
        if step is not None and item in put and step.primitive is Primitive.GRASP and scene[item].kind is Kind.ITEM:
            carried = ", ".join(fact_text(fact, True) for fact in put[item] if state.value(fact) is True)
            if carried:
                message = f"what is on or in {item} moves along: {carried}"
                place = step_place(task, step.subtask, step.position)
                yield Diagnostic("locality/cargo", "note", message, place, step.subtask, step.position)
        state = state.after(effect, time)
        for fact, value in effect:
            if value is True and len(fact) == 3 and fact[0] in RESTING:
                put.setdefault(fact[2], {})[fact] = None


class _HeldLiteral(NamedTuple):
    """A literal that holds: the index of the subtask whose goal it is, None for a fact of the scene."""

    condition: Condition
    owner: int | None


class _HeldLiterals:
    """Literals of goals and scene facts that hold so far, indexed by every pattern that covers them."""

    def __init__(self) -> None:
        self._held: dict[Fact, _HeldLiteral] = {}
        self._covered: dict[Fact, dict[Fact, None]] = {}

    def put(self, condition: Condition, owner: int | None) -> None:
        """Add a literal; its owner is the last subtask with it in the goal."""
        fact = condition.fact
        if fact not in self._held:
            for pattern in generalisations(fact):
                self._covered.setdefault(pattern, {})[fact] = None
        self._held[fact] = _HeldLiteral(condition, owner)

    def undone(self, step: Step) -> Iterator[tuple[_HeldLiteral, Value]]:
        """Remove literals that a step makes false or unknown, and yield each with its new value."""
        written = {fact for fact, _ in step.effect}
        for pattern, value in step.effect:
            for fact in tuple(self._covered.get(pattern, ())):
                standing = self._held[fact]
                if (fact == pattern or fact not in written) and standing.condition.grade(value) is not True:
                    for covering in generalisations(fact):
                        del self._covered[covering][fact]
                    del self._held[fact]
                    yield standing, value


def _changes(task: Task, scene: Scene, trace: Trace) -> Iterator[Diagnostic]:
    """Yield the changes of steps outside their subtask's scope, in the order of the plan."""
    ground, ended = _HeldLiterals(), 0
    for fact, value in scene_facts(scene):
        if value is True:
            ground.put(Condition(fact, True), None)
    for step in trace.steps:
        for index in range(ended, step.subtask):
            for atom, wanted in bddl.literals(task.subtasks[index].goal) or ():
                ground.put(condition_of(atom, wanted), index)
        ended = step.subtask
        for standing, value in ground.undone(step):
            yield from _judge(task, step, standing, value)


def _judge(task: Task, step: Step, standing: _HeldLiteral, value: Value) -> Iterator[Diagnostic]:
    """Yield a warning for a literal that a step undoes, unless its subtask is meant to change it."""
    (condition, owner), subtask = standing, task.subtasks[step.subtask]
    at = (step_place(task, step.subtask, step.position), step.subtask, step.position)
    change = f"undoes {condition.text()}" if value is not None else f"leaves open whether {condition.text()}"
    while_about = f"while the subtask is about {subtask.target}"
    if owner is None:
        if subtask.target not in condition.fact:
            yield _warning("locality/outside-scope", f"{change}, {while_about}", *at)
        return
    literal = condition.literal()
    if literal is not None and not is_meant_to_change(subtask, literal):
        goal_of, number = f"T{owner + 1} {task.subtasks[owner].name}", f"T{step.subtask + 1}"
        hint = f"do {number} before {goal_of}, or say in {number}'s goal that this is to change"
        yield _warning("locality/clobbers", f"{change}, the goal of {goal_of}, {while_about}", *at, hint)


def _warning(
    code: str, message: str, place: str, subtask: int | None = None, step: int | None = None, hint: str | None = None
) -> Diagnostic:
    return Diagnostic(code, "warning", message, place, subtask, step, hint=hint)
