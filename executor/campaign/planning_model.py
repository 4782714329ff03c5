"""Language models that plan the units of a campaign: what decides the units' ids, their recordings, one shared budget.

    DIR/answers/NAME-ID/exchanges.jsonl    what the model answered for a unit, written before it is used
                        conversation.json  its questions, findings and verdicts
    DIR/answers/used.json                  what the models of the whole folder have used

A unit that is made again asks nothing that was answered, also while a process of a killed campaign still plans it.
Keys are read from the environment by each process.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pydantic import StrictFloat, StrictInt

import llm
from bddl.files import is_disk_full
from executor.campaign.claims import exclusive_lock
from executor.system.files import content_key, json_text, write_json
from executor.system.workers import HandoverRefused
from llm.client.budget import Usage
from llm.client.connect import is_replay, recording_of, replayed
from llm.client.shared import usage_in
from llm.errors import CassetteError
from llm.structured.conversation import Spending
from llm.structured.prompting import template_sha256
from oag import Scene, Task
from oag.sizes import Sizing

ANSWERS, USED = "answers", "used.json"
EXCHANGES, CONVERSATION = "exchanges.jsonl", "conversation.json"
BUDGET_SPENT = "budget-spent"
"""Kind of failure of a unit that was not made, since the campaign's budget allows no further request."""
MODEL_FAILED = "model-failed"
"""Kind of failure of a unit that was not made, since its model gave no reply; the same command asks it again."""
ANSWERS_REFUSED = "answers-refused"
"""Kind of failure of a unit whose model gave no usable answer in the allowed rounds."""

MODULES_THAT_PLAN = range(1, 6)


def _templates() -> str:
    """Return the key of the prompts of this program."""
    return content_key(*map(template_sha256, MODULES_THAT_PLAN))


@dataclass(frozen=True, slots=True)
class PlanningModel:
    """A language model that plans units.

    Attributes:
        name: Its configuration, such as "openai:gpt-5.2".
        models: Module and configuration of its own model, in the order of modules.
        temperature, seed: How it samples; None leaves it to the server.
        templates: Key of the prompts; a program with others gives other units.
    """

    name: str
    models: tuple[tuple[StrictInt, str], ...] = ()
    temperature: StrictFloat | StrictInt | None = None
    seed: StrictInt | None = None
    templates: str = field(default_factory=_templates)

    @property
    def key(self) -> str:
        """Return eight hexadecimal digits that differ for models that may answer otherwise."""
        return content_key(json_text(asdict(self)))[:8]

    @property
    def label(self) -> str:
        """Return its name with what differs from the usual, for tables."""
        parts = [self.name, *(f"module {module} {name}" for module, name in self.models)]
        parts += [] if self.temperature is None else [f"temperature {self.temperature:g}"]
        parts += [] if self.seed is None else [f"model seed {self.seed}"]
        return ", ".join(parts)


Plan = Callable[[str, Scene, Sizing], Task]
"""Takes a sentence, a scene and the rule for sizes, and returns the planned task."""


def plan_offline(query: str, scene: Scene, sizing: Sizing) -> Task:
    """Plan a sentence without a model; raises as `llm.propose` does."""
    return llm.propose(query, scene, sizing=sizing).task


@dataclass
class ModelPlan:
    """Plans one unit by its model.

    Attributes:
        model: The model.
        place: Folder of the unit's answers.
        budget: Limits of the whole campaign.
        spending: Its rounds, once it was asked.
        repeats: Recording that answers, where a unit is run again to be looked at; nothing is then written.
    """

    model: PlanningModel
    place: Path
    budget: llm.Budget = field(default_factory=llm.Budget)
    spending: Spending | None = None
    repeats: Path | None = None

    @classmethod
    def of(cls, model: PlanningModel, folder: Path, unit_folder: str, request: Mapping[str, Any]) -> ModelPlan:
        """Return what plans a unit that a process was asked for.

        Args:
            model: The unit's model.
            folder: Folder of the campaign.
            unit_folder: Name of the unit with the begin of its id.
            request: The request to the process, with the campaign's budget.

        Raises:
            HandoverRefused: This program has other prompts.
        """
        if model.templates != _templates():
            raise HandoverRefused("this machine's program has other prompts than the one that asks for the units")
        return cls(model, folder / ANSWERS / unit_folder, llm.Budget(**request.get("budget", {})))

    @classmethod
    def repeated(cls, model: PlanningModel, recording: Path) -> ModelPlan:
        """Return what plans a unit as it was planned before, without its model."""
        named, _ = recording_of(model.name)
        # A model that is a recording alone is not recorded again.
        return cls(model, recording.parent, repeats=named if named and is_replay(model.name) else recording)

    def __call__(self, query: str, scene: Scene, sizing: Sizing) -> Task:
        """Plan a sentence; what was answered before is not asked again.

        Raises:
            QueryError, AnswersRefused: The model cannot plan it.
            ModelError: It did not reply, or the campaign's budget is spent.
        """
        with exclusive_lock(self.place) if self.repeats is None else nullcontext():
            try:
                return self._plan(query, scene, sizing)
            except CassetteError as error:
                # The next units would fare the same.
                if isinstance(error.__cause__, OSError) and is_disk_full(error.__cause__):
                    raise error.__cause__ from error
                raise

    def _plan(self, query: str, scene: Scene, sizing: Sizing) -> Task:
        model = self._connected()
        self.spending = Spending(model)
        proposer = llm.ModelProposer(model, name=self.model.name, sizing=sizing, listen=self.spending.add_round)
        try:
            return proposer.propose(query, scene).task
        finally:
            if proposer.conversation is not None and self.repeats is None:
                write_json(self.place / CONVERSATION, proposer.conversation.to_json())

    def _connected(self) -> llm.Metered:
        if self.repeats is not None:
            return replayed(self.repeats, temperature=self.model.temperature, seed=self.model.seed)
        return llm.connect(
            self.model.name,
            budget=self.budget,
            record=None if is_replay(self.model.name) else self.place / EXCHANGES,
            resume=True,
            same_start=False,
            models=dict(self.model.models),
            temperature=self.model.temperature,
            seed=self.model.seed,
            shared=self.place.with_name(USED),
        )

    def record(self) -> dict[str, Any]:
        """Return what planning the unit took, also before an interruption; nothing before the model was asked."""
        if self.spending is None:
            return {}
        rounds, costs = self.spending.rounds, [self.spending.cost_usd(entry) for entry in self.spending.rounds]
        used = {
            "requests": sum(entry.attempts for entry in rounds),
            "input_tokens": sum(entry.input_tokens or 0 for entry in rounds),
            "output_tokens": sum(entry.output_tokens or 0 for entry in rounds),
            "cost_usd": None if None in costs else sum(cost for cost in costs if cost is not None),
            "waited_s": round(sum(entry.latency_s for entry in rounds), 3),
        }
        return {"model": {"name": self.model.name, **used}}


def replay_words(model: Mapping[str, Any], recording: Path) -> list[str]:
    """Return the options by which a command plans as a unit's model did; none where no command can.

    Args:
        model: The model as a unit's file says it.
        recording: What it answered for the unit.
    """
    name = model["name"] if is_replay(model["name"]) else f"replay:{recording}"
    file, _ = recording_of(name)
    # A path with ",provider:" in it would name a model that goes on after the recording.
    if not is_replay(name) or file is None or not file.is_file():
        return []
    sampling = {"--temperature": model["temperature"], "--model-seed": model["seed"]}
    return ["--model", name, *(f"{option}={value}" for option, value in sampling.items() if value is not None)]


def planned_by(plan: Plan) -> dict[str, Any]:
    """Return what a plan's model took, for a unit's record; nothing without a model."""
    return plan.record() if isinstance(plan, ModelPlan) else {}


def model_failure(problem: llm.AnswersRefused | llm.ModelError) -> dict[str, Any]:
    """Return how a unit ends whose model gave no plan."""
    if isinstance(problem, llm.AnswersRefused):
        ended, kind = "failed", ANSWERS_REFUSED
    else:
        ended, kind = "error", BUDGET_SPENT if isinstance(problem, llm.BudgetSpent) else MODEL_FAILED
    return {"ended": ended, "failure": {"kind": kind, "message": str(problem)}}


def was_made(result: Mapping[str, Any]) -> bool:
    """Decide whether a unit came to a result that is kept: not without a reply of its model."""
    return (result.get("failure") or {}).get("kind") not in (BUDGET_SPENT, MODEL_FAILED)


def used_in(folder: Path, model: PlanningModel) -> Usage:
    """Return what the models of a campaign have used, all runs together.

    Raises:
        CassetteError: The file that says it cannot be read.
    """
    return usage_in(folder / ANSWERS / USED, model.name)


def used_text(used: Mapping[str, Any]) -> str:
    """Return what models took, in words."""
    usage = Usage(
        **{name: used[name] for name in ("requests", "input_tokens", "output_tokens", "cost_usd", "waited_s")},
        elapsed_s=used["waited_s"],
    )
    return usage.summary()


def sum_of(records: list[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Return the sum of what models took for some units (`ModelPlan.record`); None where none was asked."""
    if not records:
        return None
    names = ("requests", "input_tokens", "output_tokens", "waited_s")
    total: dict[str, Any] = {name: sum(each[name] for each in records) for name in names}
    costs = [each["cost_usd"] for each in records]
    return {**total, "cost_usd": None if None in costs else sum(costs)}


@dataclass
class ModelWatch:
    """Sees that a campaign's model gives no more plans, after which no unit is begun.

    Attributes:
        why: `OUT_OF_BUDGET` or `NO_REPLIES`; empty while there are plans.
        failed: How many units got no reply.
    """

    why: str = ""
    failed: int = 0
    _failed_in_a_row: int = 0

    def note(self, kind: str | None) -> bool:
        """Look at the kind of a unit's failure; return whether the budget allowed it."""
        if kind == BUDGET_SPENT:
            self.why = OUT_OF_BUDGET
            return False
        silent = kind == MODEL_FAILED
        self.failed += silent
        self._failed_in_a_row = self._failed_in_a_row + 1 if silent else 0
        if self._failed_in_a_row >= _MOST_FAILED_IN_A_ROW:
            self.why = self.why or NO_REPLIES
        return True


OUT_OF_BUDGET, NO_REPLIES = "model budget", "model"
# A dead server would otherwise fail every unit of a campaign in turn.
_MOST_FAILED_IN_A_ROW = 3


def why_stopped(reason: str, kept: str) -> str:
    """Return in words why a campaign stopped early, such as at a limit, and how it goes on.

    Args:
        reason: The limit, or `OUT_OF_BUDGET` or `NO_REPLIES`.
        kept: What is finished, such as "episodes".
    """
    problem = "the model gives no replies" if reason == NO_REPLIES else f"{reason} is used up"
    again = "the same command with a higher limit" if reason == OUT_OF_BUDGET else "the same command"
    return f"stopped: {problem}; finished {kept} are kept, {again} goes on"
