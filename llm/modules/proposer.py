"""The proposer behind which a language model stands: modules 1 to 5 are asked, and the graph decides what is taken.

A refuted plan goes back to the module that can mend it, with what failed, where, since when, from which start, and with
the changes that were verified to work. Nothing leaves here before `verify` has seen it whole.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import bddl
from llm.answers.ask import Log
from llm.answers.conversation import Conversation, Round
from llm.errors import QueryError
from llm.modules.context import Asked
from llm.modules.draft import Drafting
from llm.offline.planner import OfflinePlanner
from llm.offline.understand import LONGEST_QUERY
from llm.proposal import Proposal
from llm.wire.budget import Budget, Metered
from llm.wire.transport import Image, Transport
from oag import Scene, SceneError
from oag.table.start import contradictions
from oag.task.sizes import TO_THE_AIM, Sizing


@dataclass(slots=True)
class ModelProposer:
    """Proposes tasks by asking a language model.

    Attributes:
        transport: Who answers.
        name: What the model is called in proposals and records, such as "openai:gpt-5.2".
        budget: Limits for each proposal; None where the transport keeps its own, or none are wanted.
        rounds: Most questions for one answer, its form and its names being checked.
        revisions: Most times that the plan as a whole is sent back.
        images: Pictures of the scene for module 1.
        cross_check: True to ask the model once whether it means it, when its goal is not what the query says word by
            word; where the words cannot be placed, there is nothing to compare with.
        sizing: What becomes of the sizes of what is handled; module 4 is asked unless they are kept.
        listen: Gets every round.
        conversation: The record of the last proposal, also when there was none in the end.
    """

    transport: Transport
    name: str = "model"
    budget: Budget | None = None
    rounds: int = 4
    revisions: int = 6
    images: tuple[Image, ...] = ()
    cross_check: bool = True
    sizing: Sizing = TO_THE_AIM
    listen: Callable[[Round], None] | None = None
    conversation: Conversation | None = field(default=None, init=False)

    def propose(self, query: str, scene: Scene) -> Proposal:
        """Returns a task for a query in a scene that `verify` finds PROVED, or CONDITIONAL if no better one is had.

        A CONDITIONAL plan goes back once; what it rests on is then in the notes.

        Args:
            query: What the user wants.
            scene: Where it is to be done.

        Raises:
            SceneError: The scene's facts contradict each other; no model is asked about what cannot be.
            QueryError: The query is empty or too long, or the model says that it cannot be done here.
            AnswersRefused: The rounds are used up; the error has the whole story.
            ModelError: The model did not reply, the budget is spent, or the caller cancelled.
        """
        if not query.strip():
            raise QueryError("empty", query, "it asks for nothing")
        if len(query) > LONGEST_QUERY:
            raise QueryError("too-long", query, f"it has {len(query)} characters, and the most are {LONGEST_QUERY}")
        broken = contradictions(tuple(literal for fact in scene.facts for literal in bddl.literals(fact) or ()))
        if broken is not None:
            hint = "mend the scene; no plan can start from there"
            raise SceneError(broken, source=scene.name, place="facts", hint=hint)
        self.conversation = Conversation(self.name, query, scene.name, listen=self.listen)
        transport = self.transport
        if self.budget is not None:
            transport = Metered(transport, name=self.name, budget=self.budget)
        asked = Asked(transport, query, scene, Log(self.conversation), self.rounds, self.images, self.sizing)
        expected = _word_by_word(query, scene) if self.cross_check else None
        return Drafting(asked, expected, self.revisions).run()


def _word_by_word(query: str, scene: Scene) -> bddl.Formula | None:
    """Returns the goal that the offline planner reads off a query, or None where it cannot place the words."""
    try:
        return OfflinePlanner().propose(query, scene).task.goal
    except QueryError:
        return None
