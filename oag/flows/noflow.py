"""Subtasks for which no flow exists: the claim, and the set of states that proves it.

Source: docs/semantics.md, Flows that are searched; the certificate is an inductive set, as in Eriksson, Roeger and
Helmert, Unsolvability Certificates for Classical Planning (ICAPS 2017).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import bddl
from bddl.syntax.tree import Quantified
from bddl.visible import counted
from oag.flows.search import TooManyStates, legal_primitives, reachable
from oag.model.diagnostic import Diagnostic
from oag.model.facts import EEF, GRIPPER, NEAR, Fact, fact_text
from oag.model.scene import Scene
from oag.progression.compiled import compile_subtask, facts_read
from oag.progression.progress import Trace
from oag.table.library import RESTING
from oag.table.state import View, Window
from oag.task.task import SimpleTask, Task, subtask_place


@dataclass(frozen=True, slots=True)
class NoFlow:
    """The proof that a subtask has no flow.

    Attributes:
        subtask: Index of the subtask.
        facts: What the states tell of, in order.
        start: What is known where the subtask starts.
        states: States that contain the start, that no primitive leaves, and in none of which the goal can hold.
    """

    subtask: int
    facts: tuple[Fact, ...]
    start: View
    states: tuple[View, ...]

    def to_json(self) -> dict[str, object]:
        """Returns the proof as JSON values."""
        return {
            "subtask": self.subtask,
            "facts": [list(fact) for fact in self.facts],
            "start": list(self.start.values),
            "states": [list(state.values) for state in self.states],
        }


def no_flow(task: Task, scene: Scene, trace: Trace) -> NoFlow | None:
    """Returns the proof that the subtask at which a trace stopped has no flow.

    Returns:
        None when the trace did not stop, when a flow may exist, and when the search was too large to tell.
    """
    index = trace.undecided_from
    if index is None:
        return None
    subtask = task.subtasks[index]
    compiled, objects = compile_subtask(subtask, scene), scene.categories
    window = Window(facts_read((compiled,), compiled.goal, objects), objects)
    start = window.view(trace.state)
    legal = legal_primitives(scene.objects[subtask.target].kind, subtask.support_goal)
    try:
        states = reachable(start, compiled, legal)
    except TooManyStates:
        return None
    if any(state.truth(compiled.goal) is not False for state in states):
        return None
    return NoFlow(index, window.facts, start, states)


def no_flow_finding(task: Task, trace: Trace, proof: NoFlow | None) -> Iterator[Diagnostic]:
    """Yields what is to be said of the subtask without a flow at which a trace stopped."""
    index = trace.undecided_from
    if index is None:
        return
    left = len(task.subtasks) - index - 1
    after = f", nor of the {left} after it" if left else ""
    hint: str | None
    if proof is None:
        message = f"it has no action flow, so neither its goal{after} nor the task goal is decided"
        hint = "give it a flow, such as [17, 1, 2, 3], or have one searched with oag.complete"
    else:
        # Poses are left out, which flows bring about themselves.
        known = zip(proof.facts, proof.start.values, strict=True)
        start = [fact_text(fact, value) for fact, value in known if value is not None and fact not in (NEAR, EEF)]
        message = f"no sequence of primitives leads from where it starts to {bddl.format(task.subtasks[index].goal)}"
        message += f"\n{counted(len(proof.states), 'state')} can be reached, and the goal holds in none of them"
        message += f"\nit starts with {', '.join(start) or 'nothing known'}"
        hint = no_flow_hint(task.subtasks[index])
    yield Diagnostic(
        "flow/no-flow",
        "warning" if proof is None else "error",
        message,
        subtask_place(task, index),
        index,
        hint=hint,
    )


def searched_notes(task: Task, searched: tuple[int, ...]) -> Iterator[Diagnostic]:
    """Yields one note for each subtask whose flow was searched."""
    for index in searched:
        flow = " ".join(map(str, task.subtasks[index].flow or ())) or "that nothing has to be done"
        goal = bddl.format(task.subtasks[index].goal)
        message = f"it came without a flow, and a search found {flow} for {goal}"
        yield Diagnostic("flow/searched", "note", message, subtask_place(task, index), index)


def no_flow_hint(subtask: SimpleTask) -> str | None:
    """Returns what in a goal keeps every flow from reaching it; None where it is nothing of the goal's form.

    Args:
        subtask: One for which no flow exists.
    """
    target, goal = subtask.target, subtask.goal
    wanted = [
        literal.atom
        for part in bddl.conjuncts(goal)
        for literal in bddl.literals(part) or ()
        if literal.value and literal.atom.predicate in RESTING and GRIPPER not in literal.atom.args
    ]
    own = [atom for atom in wanted if atom.args[0] == target]
    others = dict.fromkeys(atom.args[0] for atom in wanted if atom.args[0] != target)
    if len(own) > 1:
        first, second = map(bddl.format, own[:2])
        return f"UNGRASP puts {target} in one place, the first that the goal names: {first} and not {second}; drop one"
    if others:
        named = ", ".join(others)
        return f"a subtask moves its target {target} alone, not {named}: give {named} a subtask of its own"
    said = [atom for atom in bddl.atoms(goal) if atom.predicate in RESTING and GRIPPER not in atom.args]
    if not own and said:
        bound = {b.variable for node in goal.walk() if isinstance(node, Quantified) for b in node.binders}
        examples = sorted(map(bddl.format, (atom for atom in said if bound.isdisjoint(atom.args))))
        return (
            f"the goal leaves a choice where {target} is to be, and no way to meet it was found to have a flow: write "
            f"the one that is meant{f', such as {examples[0]}' if examples else ''}, and see what it lacks"
        )
    return None
