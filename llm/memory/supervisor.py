"""A supervisor that tries what helped before, and asks another one when memory has nothing that may run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from difflib import SequenceMatcher

from llm.evolution.observation import GiveUp, Situation, Supervisor
from llm.memory.folder import SkillMemory
from llm.memory.recall import Recalled
from oag import Action, ActionFlow, Revision, admissible, change_between
from oag.model.primitives import ARTICULATIONS, Parameter


@dataclass(frozen=True, slots=True)
class RememberingSupervisor:
    """Tries the most similar note, then asks another supervisor; a flow from memory has to be admissible as well.

    What helped in one episode alone may be a matter of that one: it waits until an answer of the other has failed. One
    note is tried for a cause, so that a memory of what does not help here costs one attempt, and no more.

    Attributes:
        memory: The notes.
        other: Who is asked where no note helps.
    """

    memory: SkillMemory
    other: Supervisor

    def revise(self, situation: Situation) -> Revision | GiveUp:
        """Returns what a note proposes, or the other supervisor's answer."""
        iterations = situation.history.iterations
        here = [revision for attempt, revision in iterations if attempt.start == situation.attempt.start]
        failed = {revision.cause for revision in here if revision is not None and revision.note}
        for found in self.memory.similar(situation.task, situation.subtask, situation.scene, situation.attempt):
            if found.note.cause in failed or not (found.note.proven or here):
                continue
            flow = self._flow(situation, found)
            if flow is not None:
                return _revision(situation, found, flow)
        return self.other.revise(situation)

    def _flow(self, situation: Situation, found: Recalled) -> ActionFlow | None:
        flow = transfer(found.note.before, found.note.after, situation.attempt.flow)
        if flow is None or flow == situation.attempt.flow:
            return None
        history = situation.history.add(situation.attempt)
        admission = admissible(situation.task, situation.subtask, flow, scene=situation.scene, history=history)
        return flow if admission and admission.report else None


def _revision(situation: Situation, found: Recalled, flow: ActionFlow) -> Revision:
    note = found.note
    step = next((c.step for c in situation.attempt.critiques if c.finds_fault), None)
    helped = f"it helped in {note.successes} of {len(note.evidence)} runs"
    return Revision(
        flow=flow,
        change=change_between(situation.attempt.flow, flow),
        explanation=f'From memory, note "{note.name}": {helped}, and shares {", ".join(found.why)}. {note.lesson}',
        cause=note.cause,
        cause_step=step,
        note=note.name,
    )


def notes_for(memory: SkillMemory, situation: Situation, most: int = 3) -> tuple[str, ...]:
    """Returns the notes that speak of something like a situation, a line each, for a model's prompt."""
    found = memory.similar(situation.task, situation.subtask, situation.scene, situation.attempt)
    return tuple(one.note.line() for one in found[:most])


def transfer(before: ActionFlow, after: ActionFlow, flow: ActionFlow) -> ActionFlow | None:
    """Returns a flow changed as `before` was changed into `after`; None where that cannot be done.

    Flows are aligned by their primitives. Where the other flow lacks what the change hangs on, there is no transfer.

    Args:
        before: The flow that failed then.
        after: The flow that succeeded then.
        flow: The flow that fails now.
    """
    places = _places(before, flow)
    changed: list[list[Action]] = [[action] for action in flow]
    ahead: list[list[Action]] = [[] for _ in range(len(flow) + 1)]
    for tag, low, high, new_low, new_high in _matcher(before, after).get_opcodes():
        new = list(after[new_low:new_high])
        if tag == "equal":
            for old, now in zip(range(low, high), new, strict=True):
                if now.parameter != before[old].parameter:
                    if old not in places:
                        return None
                    changed[places[old]] = [_renumbered(before[old], now, flow[places[old]])]
            continue
        removed = [places.get(old) for old in range(low, high)]
        if any(place is None for place in removed):
            return None
        where = _anchor(places, low, high, len(before), len(flow))
        if where is None:
            return None
        for place in removed:
            changed[place if place is not None else 0] = []
        ahead[where] += new
    result = [action for index in range(len(flow)) for action in (*ahead[index], *changed[index])]
    return (*result, *ahead[len(flow)])


def _matcher(one: ActionFlow, other: ActionFlow) -> SequenceMatcher[int]:
    first, second = ([int(action.primitive) for action in flow] for flow in (one, other))
    return SequenceMatcher(None, first, second, autojunk=False)


def _places(before: ActionFlow, flow: ActionFlow) -> dict[int, int]:
    """Returns index in the flow of then -> index in the flow of now, for the steps that both have."""
    blocks = _matcher(before, flow).get_matching_blocks()
    return {block.a + k: block.b + k for block in blocks for k in range(block.size)}


def _anchor(places: dict[int, int], low: int, high: int, length: int, now: int) -> int | None:
    """Returns before which step of the flow of now something belongs that stood at low to high in the one of then."""
    if low in places:
        return places[low]
    if low > 0 and low - 1 in places:
        return places[low - 1] + 1
    if high < length and high in places:
        return places[high]
    return now if low == length == 0 else None


def _renumbered(then: Action, became: Action, now: Action) -> Action:
    """Returns an action with its number changed as it was changed then.

    Limits of a joint and numbers that were opened are taken as they are; a distance is changed by as much, so that a
    flow with another distance is not thrown back to the one of then.
    """
    before, after, number = then.parameter, became.parameter, now.parameter
    shifted: Parameter = after
    if isinstance(before, float | int) and isinstance(after, float | int) and isinstance(number, float | int):
        moved = round(number + after - before, 3)
        shifted = moved if moved > 0 and now.primitive not in ARTICULATIONS else after
    return replace(now, parameter=shifted)
