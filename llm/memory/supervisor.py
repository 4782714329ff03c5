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
        failed = {revision.cause for revision in here if revision is not None and note_used(revision.explanation)}
        for found in self.memory.similar(situation.task, situation.subtask, situation.scene, situation.attempt):
            if found.note.cause in failed or not (found.note.proven or here):
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
