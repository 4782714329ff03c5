"""Set up a self-evolution from options: model or measurements as judges, pictures, budget."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from executor.cli.errors import BadOption
from executor.cli.options import JudgeOptions, ModelOptions
from executor.cli.output import tell, tell_progress
from executor.reports.run_folder import EXCHANGES, USAGE, kept_aside, unused_path
from executor.rollouts.evolution_record import AttemptFrames, Evolution
from executor.rollouts.evolve import evolve
from executor.sim.render.cameras import VIEWS
from executor.system import vulkan
from executor.system.files import write_json
from llm import Budget, Metered, connect
from llm.client.connect import is_replay, recording_of
from llm.errors import LlmError, ModelError, PicturesMissing
from llm.evolve import Inspector, MeasuredInspector, SearchSupervisor, Supervisor
from llm.evolve.judges import Judges, judges
from llm.structured.conversation import MODULES, Spending
from oag import ObjectActionGraph, Scene

CONVERSATIONS, PICTURES = "conversations.json", "pictures"
NO_VIEWS = "none"


class EvolutionSetup:
    """The judges of a run's episodes; a context manager that writes their conversations at its end.

    Attributes:
        frames: Renderer of failed attempts; None where no pictures are needed, or nothing can draw them.
        spending: The judges' model and its usage; None without a model.
        teams: The judges of the episodes so far, where there is a model.
    """

    def __init__(
        self,
        options: JudgeOptions,
        out: Path | None,
        *,
        force: bool = False,
        resume: bool = False,
        spending: Spending | None = None,
        pictures: bool = False,
        quiet: bool = False,
    ) -> None:
        """Connect to the model; nothing is sent.

        Args:
            options: The typed options.
            out: The run's folder; None keeps nothing.
            force: Begins a new recording; an earlier one is kept under another name.
            resume: Goes on with an earlier recording, and keeps earlier conversations.
            spending: A model that is connected already, whose caller records it.
            pictures: Whether the report needs pictures, without a model that looks at them; a machine that cannot draw
                prints a warning, and everything else is done.
            quiet: Prints no rounds.
        """
        self._options, self._out, self._resume = options, out, resume
        self.views = parse_views(options.views)
        if options.look_back < 0:
            raise BadOption("--look-back", options.look_back, "0 or more")
        if options.inspect == "faulty" and options.model is None:
            raise BadOption("--inspect", options.inspect, "--model with it: without one, measurements judge all steps")
        if options.inspect == "faulty" and not options.measurements:
            raise BadOption("--inspect", options.inspect, "no --no-measurements: measurements tell what is faulty")
        if not self.views and not options.measurements:
            raise BadOption("--views", NO_VIEWS, "at least one view where --no-measurements is given")
        self.frames = self._frames_for_model() if options.model is not None and self.views else None
        self.spending = spending or spending_of(self._connected(force=force, resume=resume), quiet=quiet)
        if self.frames is None and pictures:
            self.frames = _frames_for_report()
        self.teams: list[Judges] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.frames is not None:
            self.frames.__exit__(kind, error, trace)
        if self._out is not None and self.teams:
            path = unused_path(self._out, CONVERSATIONS) if self._resume else self._out / CONVERSATIONS
            write_json(path, [team.conversation.to_json() for team in self.teams])
            if self.spending is not None:
                write_json(self._out / USAGE, self.spending.to_json())

    def judges(
        self, task: str, scene: Scene, *, views: tuple[str, ...] | None = None, look_back: int | None = None
    ) -> tuple[Inspector, Supervisor]:
        """Return the inspector and the supervisor of one episode.

        Args:
            task: Name of the task, for the record.
            scene: The scene.
            views: Cameras that replace the typed ones.
            look_back: Steps to look back that replace the typed number.
        """
        if self.spending is None:
            return MeasuredInspector(), SearchSupervisor()
        team = judges(
            self.spending.model,
            name=self._options.model or "",
            task=task,
            scene=scene.name,
            views=self.views if views is None else views,
            look_back=self._options.look_back if look_back is None else look_back,
            measurements=self._options.measurements,
            most_pictures=self._options.most_pictures,
            only_faulty=self._options.inspect == "faulty",
            listen=self.spending.add_round,
        )
        self.teams.append(team)
        return team.inspector, team.supervisor

    def evolve(
        self,
        graph: ObjectActionGraph,
        *,
        views: tuple[str, ...] | None = None,
        look_back: int | None = None,
        **how: Any,
    ) -> Evolution:
        """Return an episode whose failing flows these judges revised.

        Args:
            graph: The proved plan.
            views, look_back: As for `judges`.
            how: Further arguments of `executor.evolve`: seed, limit, conditions.
        """
        inspector, supervisor = self.judges(graph.task.name, graph.scene, views=views, look_back=look_back)
        return evolve(graph, inspector=inspector, supervisor=supervisor, frames=self.frames, **how)

    @property
    def stopped(self) -> str:
        """Why the model that judges gave no more answers in the latest episode; empty otherwise."""
        return self.teams[-1].stopped if self.teams else ""

    def _connected(self, *, force: bool, resume: bool) -> Metered | None:
        options = self._options
        if options.model is None:
            return None
        record = None
        if self._out is not None and not is_replay(options.model):
            self._out.mkdir(parents=True, exist_ok=True)
            record = self._out / EXCHANGES
            if force and not resume and (record.exists() or record.is_symlink()):
                # An unreachable model must not move a recording.
                connect_model(options, None)
                tell_kept(kept_aside(record))
                record.unlink(missing_ok=True)
        # Episodes that are finished ask nothing, so the first question may be a later one's.
        return connect_model(options, record, resume=resume, same_start=False)

    def _frames_for_model(self) -> AttemptFrames:
        """Return the renderer of attempts; a replay first searches the pictures next to its recording."""
        model = self._options.model or ""
        kept = None if self._out is None else self._out / PICTURES
        recording, _ = recording_of(model)
        if recording is not None and (recording.parent / PICTURES).is_dir():
            return AttemptFrames(self.views, folder=kept, recorded=recording.parent / PICTURES)
        renderer = vulkan.find_renderer()
        if not renderer:
            raise PicturesMissing(f"{renderer.why} {renderer.remedy}".strip())
        return AttemptFrames(self.views, folder=kept)


def _frames_for_report() -> AttemptFrames | None:
    renderer = vulkan.find_renderer()
    if not renderer:
        tell(f"no pictures: {renderer.why} {renderer.remedy}".strip(), style="yellow")
    return AttemptFrames() if renderer else None


def tell_kept(recording: Path | None) -> None:
    """Print where the answers of an earlier run are kept when a run starts over."""
    if recording is not None:
        tell(f"the answers that were recorded before are kept in {recording}", style="yellow")


def stopped_message(reason: str) -> str:
    """Return the message for a model that stopped answering as a judge."""
    reported = f"the model that judges stopped answering, and nothing more was tried: {reason}"
    return f"{reported}. What was done is kept, and --resume goes on"


def spending_of(model: Metered | None, *, quiet: bool) -> Spending | None:
    """Return the usage counter of a model, which prints each round in a line; None without a model."""
    return None if model is None else Spending(model, tell_progress(quiet))


@contextmanager
def report_spending_on_error(spending: Spending | None, *, quiet: bool) -> Iterator[None]:
    """Print the usage so far, and how to go on, where a model's failure or Ctrl-C ends a command.

    Raises:
        ModelInterrupted: Ctrl-C.
    """
    try:
        yield
    except (Exception, KeyboardInterrupt) as error:
        if spending is None:
            raise
        if not quiet:
            tell(f"  {spending.total()}")
        if isinstance(error, KeyboardInterrupt):
            raise ModelInterrupted(spending.to_json()) from error
        if isinstance(error, LlmError):
            error.usage = spending.to_json()
        # Answers that did not hold would come again.
        goes_on = isinstance(error, ModelError) or not isinstance(error, LlmError)
        if goes_on and spending.rounds and not quiet and not is_replay(spending.model.name):
            tell("  what was answered is recorded, and not asked again with --resume")
        raise


class ModelInterrupted(KeyboardInterrupt):
    """Ctrl-C during a model call; `usage` is the usage until then."""

    def __init__(self, usage: Mapping[str, object]) -> None:
        super().__init__("interrupted; what was answered is recorded, and not asked again with --resume")
        self.usage = usage


def connect_model(
    options: ModelOptions,
    record: Path | None,
    *,
    resume: bool = False,
    same_start: bool = True,
    starts: bool = True,
) -> Metered | None:
    """Return the typed model with its budget, None without one; nothing is sent.

    Warnings about a recording are printed.

    Args:
        options: The typed options.
        record: The file of its recording; a replay has its recording already.
        resume, same_start, starts: As for `llm.connect`.
    """
    if options.model is None:
        if options.models:
            raise BadOption("--models", " ".join(options.models), "--model with it")
        return None
    budget = Budget(tokens=options.max_tokens, cost_usd=options.max_cost_usd, time_s=options.max_time_s)
    model = connect(
        options.model,
        budget=budget,
        record=None if is_replay(options.model) else record,
        resume=resume,
        same_start=same_start,
        models=by_module(options.models),
        temperature=options.temperature,
        seed=options.model_seed,
        starts=starts,
    )
    for warning in model.warnings:
        tell(warning, style="yellow")
    return model


def by_module(given: Sequence[str]) -> dict[int, str]:
    """Parse the models of single modules and judges, such as 3=openai:gpt-5.2."""
    found: dict[int, str] = {}
    for words in given:
        who, _, model = words.partition("=")
        number = MODULES.get(who.strip().lower().removeprefix("module").strip())
        if number is None or not model or number in found:
            raise BadOption("--models", words, f"one of {', '.join(MODULES)}, = and a model, each once")
        found[number] = model.strip()
    return found


def parse_views(text: str) -> tuple[str, ...]:
    """Parse the cameras that an option names, in the order of `VIEWS`; "none" names none."""
    words = [word.strip().lower() for word in text.split(",") if word.strip()]
    if words == [NO_VIEWS]:
        return ()
    if not words or any(word not in VIEWS for word in words):
        raise BadOption("--views", text, f"some of {', '.join(VIEWS)}, with commas between them, or {NO_VIEWS}")
    return tuple(view for view in VIEWS if view in words)
