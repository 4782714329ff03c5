"""A supervisor that tries what helped before, and asks another one when memory has nothing that may run."""

from __future__ import annotations

from dataclasses import dataclass

from llm.evolution.supervisor import GiveUp, Situation, Supervisor
from llm.memory.folder import SkillMemory
from llm.memory.learning import note_used, remembered
from llm.memory.recall import Recalled
from llm.memory.transfer import transfer
from oag import ActionFlow, Revision, admissible, change_between


@dataclass(frozen=True, slots=True)
class RememberingSupervisor:
    """Tries notes first, the most similar one first and each once; a flow from memory has to be admissible as well.

    Attributes:
        memory: The notes.
        other: Who is asked where no note helps.
    """

    memory: SkillMemory
    other: Supervisor

    def revise(self, situation: Situation) -> Revision | GiveUp:
        """Returns what a note proposes, or the other supervisor's answer."""
        used = {note_used(revision.explanation) for revision in situation.history.revisions}
        for found in self.memory.similar(situation.task, situation.subtask, situation.scene, situation.attempt):
            if found.note.name in used:
                continue
            flow = self._flow(situation, found)
            if flow is not None:
                return _revision(situation, found, flow)
        return self.other.revise(situation)

    def _flow(self, situation: Situation, found: Recalled) -> ActionFlow | None:
        """Returns the flow that a note proposes for a situation, if it may run."""
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
        explanation=f"{remembered(note.name)}: {helped}, and shares {', '.join(found.why)}. {note.lesson}",
        cause=note.cause,
        cause_step=step,
    )


def notes_for(memory: SkillMemory, situation: Situation, most: int = 3) -> tuple[str, ...]:
    """Returns the notes that speak of something like a situation, a line each, for a model's prompt."""
    found = memory.similar(situation.task, situation.subtask, situation.scene, situation.attempt)
    return tuple(one.note.line() for one in found[:most])
