"""`scene2demo stability`: decompose a sentence again and again, in changed words and scenes, and count the forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from executor.cli.errors import DONE, FAILED, check
from executor.cli.options import (
    CommonOptions,
    Flag,
    FullSize,
    Maybe,
    ModelOptions,
    ReplaceFile,
    RobotName,
    SceneName,
    Sentence,
)
from executor.cli.output import counting, print_json, say, tell

if TYPE_CHECKING:
    from llm import Metered
    from oag import Scene, Task


@dataclass(frozen=True)
class Options(CommonOptions):
    """Decompose a sentence again and again, rephrased and in changed scenes, and count the forms of the plans.

    Nothing moves. The first run is of the sentence and the scene as they are; later ones change one thing each, in
    turn, then all together. Names are taken back before plans are compared. The exit code is 0 when all forms are one.
    """

    query: Sentence
    scene: SceneName
    asked: ModelOptions = field(default_factory=ModelOptions)
    record: Maybe[Path] = None
    """With --model: file for what the model answers; --model replay:FILE repeats it."""
    runs: Annotated[int, tyro.conf.arg(aliases=("-n",))] = 20
    """How many runs."""
    perturb: str = "paraphrase,rename,order,distractors,mirror"
    """What is changed, with commas between the words; none: every run repeats the first."""
    seed: int = 0
    """Decides all changes."""
    flows: Flag = False
    """Count plans with other actions or numbers as other forms; by default the subtasks alone count."""
    full_size: FullSize = False
    robot: RobotName = None
    out: Maybe[Path] = None
    """File for the picture (SVG): how many runs have how many subtasks, a part for each form."""
    force: ReplaceFile = False


def execute(options: Options) -> int:
    """Print the forms with counts, verdicts and examples, and write the picture where requested."""
    check(options.runs >= 1, "--runs", options.runs, "at least 1")
    check(options.record is None or options.asked.model is not None, "--record", options.record, "--model with it")
    quiet = options.json
    with counting("loading the planner", quiet=quiet):
        from executor.cli.evolution_setup import connect_model, report_spending_on_error, spending_of
        from executor.cli.inputs import refuse_existing, robot_asked_for
        from executor.scenes.file import scene_for
        from executor.system.files import write_text
        from llm import AnswersRefused, QueryError
        from llm.offline.reader import paraphrases
        from oag import stability
    for name, path in (("--out", options.out), ("--record", options.record)):
        if path is not None:
            refuse_existing(path, force=options.force, option=name)
    scene = scene_for(
        options.query,
        options.scene,
        robot=robot_asked_for(options.robot, full_size=options.full_size),
        listen=lambda notes: None,
    )
    words = [word.strip() for word in options.perturb.split(",") if word.strip()]
    model = connect_model(options.asked, options.record)
    spending = spending_of(model, quiet=True)
    with report_spending_on_error(spending, quiet=quiet), counting("decomposing", quiet=quiet) as on_progress:
        found = stability(
            _decomposer(model, options.asked.model or ""),
            options.query,
            scene,
            options.runs,
            [] if words == ["none"] else words,
            seed=options.seed,
            flows=options.flows,
            # Sentences that the planner reads as it reads the query; of others, courteous forms.
            wordings=paraphrases(options.query) or None,
            refusals=(QueryError, AnswersRefused),
            listen=on_progress,
        )
    if quiet:
        usage = {} if spending is None else {"usage": spending.to_json()}
        print_json({"ok": bool(found), "exit_code": DONE if found else FAILED, **found.to_json(), **usage})
    else:
        say(str(found))
    if options.out is not None:
        write_text(options.out, found.to_svg())
        tell(f"written: {options.out}")
    return DONE if found else FAILED


def _decomposer(model: Metered | None, name: str) -> Callable[[str, Scene], Task]:
    """Return what decomposes: the offline planner, or a model that is asked each time."""
    from llm import ModelProposer, propose

    if model is None:
        return lambda query, scene: propose(query, scene).task
    return lambda query, scene: ModelProposer(model, name=name).propose(query, scene).task
