"""What all five modules share: who is asked, how often, where it is kept, and what the checks of `oag` are run on."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import bddl
from llm.answers.ask import Log, ask
from llm.answers.base import Answer, SubtaskAnswer
from llm.answers.conversation import errors_of, finding
from llm.answers.describe import scene_table
from llm.answers.prompting import Prompt, Refused, fenced, render
from llm.wire.transport import Image, Transport
from oag import Diagnostic, Scene, SimpleTask, Task
from oag.task.reading import UNREADABLE
from oag.task.sizes import TO_THE_AIM, Sizing

Given = TypeVar("Given", bound=Answer)


@dataclass(slots=True)
class Asked:
    """What the modules ask with.

    Attributes:
        transport: Who answers.
        query: The user's query.
        scene: The scene it is about.
        log: Where everything is kept.
        rounds: Most questions for one answer.
        images: Pictures of the scene, for module 1.
        sizing: What becomes of the sizes of what is handled.
        objections: For a module that is asked again: its earlier answer, and what the graph found wrong with it.
        taken: The prompt that each module asked last, and the answer that it took.
    """

    transport: Transport
    query: str
    scene: Scene
    log: Log
    rounds: int
    images: tuple[Image, ...] = ()
    sizing: Sizing = TO_THE_AIM
    objections: dict[int, Refused] = field(default_factory=dict)
    taken: dict[int, tuple[Prompt, Answer]] = field(default_factory=dict)

    def ask(
        self,
        module: int,
        schema: type[Given],
        check: Callable[[Given], Iterable[Diagnostic]],
        places: Mapping[str, str],
        images: tuple[Image, ...] = (),
        *,
        entries: int = 0,
    ) -> Given:
        """Returns a module's answer once `check` finds nothing wrong with it.

        Args:
            module: 1 to 5; its prompt file is filled with `places` and the scene.
            schema: The form of its answer.
            check: What is wrong with an answer of that form.
            places: Texts for the places of the prompt file.
            images: Pictures that go with it.
            entries: How many numbered subtasks the answer has to be about, where that is known already; the numbers
                are checked before anything else.

        Raises:
            AnswersRefused: No answer held.
            ModelError: There is no reply.
        """
        scene = fenced("scene", scene_table(self.scene))
        text = render(f"modules/module_{module}", scene=scene, **places)
        prompt = Prompt(module, render("modules/system"), text, images)
        objection = self.objections.pop(module, None)

        def numbered(answer: Given) -> Iterable[Diagnostic]:
            wrong = numbering(getattr(answer, answer.list_name), entries) if entries else ()
            return wrong or check(answer)

        answer = ask(self.transport, prompt, schema, numbered, rounds=self.rounds, log=self.log, objection=objection)
        self.taken[module] = (prompt, answer)
        return answer

    def object_to(self, module: int, findings: tuple[Diagnostic, ...]) -> None:
        """Notes what is wrong with the answer that a module took, for when it is asked again."""
        prompt, answer = self.taken[module]
        if errors_of(findings):
            self.log.refuse(prompt, answer, findings)
        self.objections[module] = Refused(json.dumps(answer.model_dump()), findings)


def bare_task(scene: Scene, subtasks: Iterable[SimpleTask] = (), goal: bddl.Formula = UNREADABLE) -> Task:
    """Returns a task of what is known so far, for the checks of form."""
    return Task("task", "", goal, True, tuple(subtasks), {}, scene)


def numbering(entries: Sequence[SubtaskAnswer], wanted: int | None = None) -> tuple[Diagnostic, ...]:
    """Returns what is wrong with the numbers of an answer's entries, which count 1, 2, 3 up to `wanted` if given."""
    numbers = [entry.sub_task for entry in entries]
    count = len(numbers) if wanted is None else wanted
    if numbers == list(range(1, count + 1)):
        return ()
    said = f"the subtasks are numbered {', '.join(map(str, numbers))}; expected 1 to {count}, each once and in order"
    missing = [str(number) for number in range(1, count + 1) if number not in numbers]
    if missing:
        said += f"; {', '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
    return (finding("answer/numbering", said, "sub_tasks"),)
