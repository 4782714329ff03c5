"""State that the modules share while they ask a model, and the part of a scene that a question shows."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from llm.client.transport import Image, Transport
from llm.offline.grounding import Grounding
from llm.offline.lexicon import built_in
from llm.offline.names import singulars
from llm.offline.rereading import named_in
from llm.structured.ask import Log, ask
from llm.structured.conversation import entries_of, errors_of, finding
from llm.structured.prompting import Prompt, Refused, concerned, fenced, formula_pattern, one_of, render, scene_table
from llm.structured.schema import Admitted, Answer, Form, SubtaskAnswer
from oag import Diagnostic, Scene
from oag.sizes import TO_THE_AIM, Sizing

AnswerT = TypeVar("AnswerT", bound=Answer)


@dataclass(slots=True)
class ModuleSession:
    """State that the modules share while they ask a model.

    Attributes:
        transport: Transport to the model.
        query: The user's query.
        scene: The scene.
        log: Record of the rounds.
        rounds: Most questions for one answer.
        images: Pictures of the scene, for module 1.
        sizing: Rule for the sizes of manipulated objects.
        objections: Module -> its earlier answer with the graph's findings, for a module that is asked again.
        taken: Module -> its last prompt, and the accepted answer.
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
        schema: type[AnswerT],
        check: Callable[[AnswerT], Iterable[Diagnostic]],
        places: Mapping[str, str],
        images: tuple[Image, ...] = (),
        *,
        about: Iterable[str] | None = None,
        entries: int = 0,
        forms: Callable[[Sequence[str]], Sequence[Form]] = lambda _: (),
        template: str = "",
        readings: Sequence[str] = (),
    ) -> AnswerT:
        """Return a module's answer once `check` finds nothing wrong with it.

        Args:
            module: Its number.
            schema, check: As for `llm.structured.ask.ask`.
            places: Texts of the prompt's template, besides the scene's.
            images: Pictures of the question.
            about: The objects that the question is about; None for what the query mentions.
            entries: How many entries the answer's list has; 0 where that is the answer's own.
            forms: Returns the alternatives of an entry (`Admitted`) by the objects that are shown.
            template: The template of a further question of the module; its answer does not replace the module's own.
            readings: The formulas that can be answered; without any, all that can hold in the scene.

        Raises:
            AnswersRefused: No answer was valid.
            ModelError: There is no reply.
        """
        shown = mentioned(self.query, self.scene) if about is None else concerned(self.scene, about)
        table = scene_table(self.scene, shown, measures=module in _WITH_MEASURES)
        text = render(f"proposing/{template or f'module_{module}'}", scene=fenced("scene", table), **places)
        prompt = Prompt(module, render("proposing/system"), text, images)
        objection = None if template else self.objections.pop(module, None)

        def numbered(answer: AnswerT) -> Iterable[Diagnostic]:
            wrong = check_numbering(getattr(answer, answer.list_name), entries) if entries else ()
            return wrong or check(answer)

        ids = [key for key in self.scene.objects if key in shown]
        formulas = one_of(readings) if readings else formula_pattern(self.scene, ids)
        answer = ask(
            self.transport,
            prompt,
            schema,
            numbered,
            rounds=self.rounds,
            log=self.log,
            objection=objection,
            standing=self._standing(module, schema) if objection is not None else None,
            admitted=Admitted(ids, entries, formulas, forms(ids)),
        )
        if not template:
            self.taken[module] = (prompt, answer)
        return answer

    def _standing(self, module: int, schema: type[AnswerT]) -> AnswerT | None:
        """Return a module's accepted answer."""
        answer = self.taken[module][1]
        return answer if isinstance(answer, schema) else None

    def object_to(self, module: int, findings: tuple[Diagnostic, ...]) -> None:
        """Store the findings about a module's accepted answer for the next time it is asked."""
        prompt, answer = self.taken[module]
        if errors_of(findings):
            self.log.refuse(prompt, answer, findings)
        wrong = entries_of(findings) if module in _WITH_FIXED_ENTRIES else ()
        self.objections[module] = Refused(answer.shown(), findings, entries=wrong)


# Modules whose entries follow from module 2's.
_WITH_FIXED_ENTRIES = (3, 4, 5)
# Sizes and positions decide which object is meant, and how far the robot moves.
_WITH_MEASURES = (1, 5)
# Scenes of up to so many objects are shown whole to module 1.
_MOST_SHOWN = 30
# Characters of the longest table of a scene: about 4,500 tokens of the 8,192 that a small model has.
_LONGEST_TABLE = 9_000


def mentioned(query: str, scene: Scene) -> frozenset[str]:
    """Return the objects whose names a query has, with their surroundings; of a small scene all.

    A query without any name of the scene, or in another language, is about all objects, or as many as a prompt holds.
    """
    if len(scene.objects) <= _MOST_SHOWN:
        return frozenset(scene.objects)
    # Names that say nothing, such as "thing", are those of every item.
    return concerned(scene, named(query, scene)[:_MOST_SHOWN]) or _as_many_as_fit(scene)


def named(query: str, scene: Scene) -> tuple[str, ...]:
    """Return the objects that a query names, by their ids or in words."""
    words = re.findall(r"[a-z0-9_]+", query.lower())
    words = [form for word in words for form in (word, *singulars(word))]
    in_words = Grounding.of(scene, built_in()).names.mentioned(words)
    return tuple(dict.fromkeys((*named_in(query, scene.objects), *in_words)))


def _as_many_as_fit(scene: Scene) -> frozenset[str]:
    """Return all objects, or the most whose table is short enough: of each category one, then a second, and so on."""
    counts: Counter[str] = Counter()
    ranked: list[tuple[int, int, str]] = []
    for key, thing in scene.objects.items():
        ranked.append((counts[thing.category], len(ranked), key))
        counts[thing.category] += 1
    order = [key for *_, key in sorted(ranked)]
    numbers = range(1, len(order) + 1)
    fitting = bisect_right(numbers, _LONGEST_TABLE, key=lambda number: len(scene_table(scene, {*order[:number]})))
    return frozenset(order[:fitting])


def check_numbering(entries: Sequence[SubtaskAnswer], wanted: int | None = None) -> tuple[Diagnostic, ...]:
    """Return findings about the numbers of an answer's entries: they have to be 1, 2, 3 up to `wanted`, if given."""
    numbers = [entry.sub_task for entry in entries]
    count = len(numbers) if wanted is None else wanted
    if numbers == list(range(1, count + 1)):
        return ()
    message = f"the subtasks are numbered {', '.join(map(str, numbers))}; expected 1 to {count}, each once and in order"
    missing = [str(number) for number in range(1, count + 1) if number not in numbers]
    if missing:
        message += f"; {', '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
    return (finding("answer/numbering", message, "sub_tasks"),)
