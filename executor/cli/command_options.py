"""Options of each sub-command: one class each, whose docstring and whose fields' docstrings are the help.

Nothing but the standard library and tyro is loaded to read them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import tyro

from executor.cli.data_options import (
    DatasetOptions,
    EvaluateOptions,
    GenerateOptions,
    ReplayOptions,
    TrainOptions,
)
from executor.cli.options import (
    READ_SCENE,
    BddlFiles,
    CommonOptions,
    Episodes,
    EpisodesFolder,
    FirstSeed,
    Flag,
    FullSize,
    GoOn,
    KeepSizes,
    Limit,
    MaxCost,
    MaxTime,
    MaxTokens,
    Maybe,
    OptionalScene,
    PhotoInputs,
    Profile,
    Read,
    ReplaceFile,
    ReplaceResults,
    ResultsFolder,
    SceneName,
    Sentence,
    Size,
    TaskFile,
    TaskToRun,
    Video,
    negated_flag,
)


@dataclass(frozen=True)
class VerifyOptions(CommonOptions):
    """Decide whether a task's plan reaches its goal, without moving anything."""

    task: TaskFile
    scene: OptionalScene = None
    out: Maybe[Path] = None
    """File for the task: with a fix applied when the plan is refuted, else with the flows that were searched; its
    folder is made when absent."""
    apply: Maybe[int] = None
    """Which fix to apply, by its number; by default the first, which is the smallest that proves the plan."""
    certificate: Maybe[Path] = None
    """File for the certificate, which `recheck` checks; its folder is made when absent."""
    force: ReplaceFile = False


@dataclass(frozen=True)
class GraphOptions(CommonOptions):
    """Draw the object-action graph of a task, or write it for other tools."""

    task: TaskFile
    scene: OptionalScene = None
    format: Maybe[Literal["svg", "mermaid", "dot", "graphml", "json"]] = None
    """What to write: a picture, or text for Mermaid, Graphviz, graph editors or programs; by default what the ending of
    --out says (.svg .mmd .dot .graphml .json), or a picture."""
    out: Maybe[Path] = None
    """The file to write, its folder made when absent; by default standard output."""
    force: ReplaceFile = False
    json: Flag = field(default=False, kw_only=True)
    """The same as `--format json`."""


@dataclass(frozen=True)
class RecheckOptions(CommonOptions):
    """Check a certificate without trusting the verifier that wrote it."""

    certificate: tyro.conf.Positional[Annotated[Path, Read("certificate")]]
    """The certificate's JSON file, or that of a report: what `verify --json` prints."""
    task: Annotated[Maybe[Path], Read("task")] = None
    """The task's JSON file that it has to be about; by default any."""
    scene: Annotated[Maybe[str], READ_SCENE] = None
    """Name of the scene, or the scene's JSON file, that it has to be about; by default any."""


Family = Literal["T1", "T2", "T3", "T4", "T5", "T6"]


@dataclass(frozen=True)
class RunOptions(CommonOptions):
    """Turn a sentence and a scene, or a photograph of one, into a verified plan, a rollout, a video and a dataset."""

    query: Sentence
    out: ResultsFolder
    scene: Maybe[SceneName] = None
    photo: Annotated[Maybe[Path], Read()] = None
    """Instead of --scene: a photograph or a recording that the scene is made of, once; it is kept in OUT/photo."""
    photo_inputs: PhotoInputs = field(default_factory=PhotoInputs)
    model: Maybe[str] = None
    """Language model that plans, such as openai:gpt-5.2, ollama:qwen3-vl or replay:FILE; by default none does."""
    max_tokens: MaxTokens = None
    max_cost_usd: MaxCost = None
    max_time_s: MaxTime = None
    image: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction] = ()
    """With --model: picture of the scene that the model sees with the query; may be given several times."""
    seed: int = 0
    """Varies the scene and seeds the planning."""
    keep_sizes: KeepSizes = False
    full_size: FullSize = False
    evolve: Flag = False
    """Revise the flows that fail, by measurements, or by the model where there is one."""
    limit: Limit = 5
    memory: Maybe[Path] = None
    """With --evolve: folder of notes on corrections that helped before; new ones are written down."""
    resume: GoOn = False
    force: ReplaceResults = False
    video: Video = True
    size: Size = (224, 224)
    record_hz: float = 10.0
    """Recorded samples a second of simulated time."""


@dataclass(frozen=True)
class PlanOptions(CommonOptions):
    """Plan a sentence in a scene, prove the plan, and ask whether the arm reaches what it needs; nothing moves.

    What is asked of the arm: a base pose on free floor and a posture inside its joints' limits for everything that the
    plan takes hold of, and for a spot wherever it puts it. Collisions, paths and physics are not looked at.
    """

    begins: ClassVar[str] = "loading the planner and the simulator"
    query: Sentence
    scene: SceneName
    seed: int = 0
    """What the widths of what the gripper takes are drawn from, as `run` draws them."""
    keep_sizes: KeepSizes = False
    full_size: FullSize = False


@dataclass(frozen=True)
class RolloutOptions(CommonOptions):
    """Execute a task file in the physics, over one or more seeds, and count successes."""

    task: TaskToRun
    scene: SceneName
    seed: FirstSeed = 0
    episodes: Episodes = 1
    open_numbers: Flag = False
    """Leave all numbers of the flows to the planner, so that every episode has its own."""
    keep_sizes: KeepSizes = False
    workers: int = 1
    """How many processes to run them in; one that crashes costs its episode only."""
    out: EpisodesFolder = None
    force: ReplaceResults = False


@dataclass(frozen=True)
class JudgeOptions:
    """Who judges the steps of a failed attempt and revises its flow."""

    model: Maybe[str] = None
    """Language model that judges and revises, such as openai:gpt-5.2 or replay:FILE; by default measurements do."""
    max_tokens: MaxTokens = None
    max_cost_usd: MaxCost = None
    max_time_s: MaxTime = None
    views: str = "global,head,wrist"
    """Cameras whose pictures the model sees, with commas between them; none: it is told measurements only."""
    look_back: int = 1
    """How many steps before the judged one the model sees as well."""
    measurements: Annotated[Flag, negated_flag("Show the model pictures only, and not what was measured.")] = True
    most_pictures: Maybe[int] = None
    """Most pictures in a question; by default 36 for a step, 24 for a revision."""
    memory: Maybe[Path] = None
    """Folder of notes: corrections that helped before are tried first, and new ones are written down."""


@dataclass(frozen=True)
class EvolveOptions(CommonOptions):
    """Execute a task file, and revise the flows that fail until they succeed or nothing is left to try."""

    task: TaskToRun
    scene: SceneName
    seed: FirstSeed = 0
    episodes: Episodes = 1
    limit: Limit = 5
    keep_sizes: KeepSizes = False
    fault: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="KIND:...")] = ()
    """What is wrong on purpose, such as pose:glass_0,size_m=0.02 or grip:force_n=2; may be given several times."""
    judged: JudgeOptions = field(default_factory=JudgeOptions)
    out: EpisodesFolder = None
    resume: Flag = False
    """Keep the finished episodes that the folder has, and run the others."""
    pictures: Flag = False
    """Draw the failed steps of all attempts for the report; needs a renderer."""
    force: ReplaceResults = False


@dataclass(frozen=True)
class BenchOptions(CommonOptions):
    """Measure success rates over many episodes, and print them beside the paper's main table.

    Goes on where an earlier run with the same folder ended. `scene2demo bench replay FOLDER UNIT --out OTHER` shows
    one unit as a video.
    """

    families: tyro.conf.Positional[
        Annotated[tuple[Family, ...], tyro.conf.arg(metavar="T1..T6", help_behavior_hint="(required)")]
    ]
    """What to measure: T1 to T4 are the long-horizon tasks, T5 opening and closing, T6 picking and placing."""
    out: ResultsFolder
    episodes: int = 20
    """How many units of each family; those of T5 and T6 go through one set of pairs after the other."""
    seed: int = 0
    """Seed of the first episode, or of the first set of pairs; the following ones count up."""
    workers: int = 2
    """How many processes; one that crashes costs its unit only."""
    flows: Literal["planned", "paper"] = "planned"
    """The offline planner's flows, whose numbers geometry fills in, or the paper's initial flows, numbers verbatim."""
    evolve: Flag = False
    """Revise the flows that fail."""
    views: Flag = False
    """Draw three cameras' pictures of every success (color, depth, segmentation), for the time that it takes."""
    keep_sizes: KeepSizes = False
    full_size: FullSize = False
    shard: str = "1/1"
    """Which part of the units to run, such as 3/8; all parts may share a folder."""
    again: Flag = False
    """Run units once more whose process crashed, hung, or met a mistake of the program."""
    limit_s: float = 900.0
    """Wall time that a unit may take before its process is ended."""


@dataclass(frozen=True)
class BenchReplayOptions(CommonOptions):
    """Run one unit of a benchmark again, and make a report with a video of it."""

    folder: tyro.conf.Positional[Annotated[Path, Read()]]
    """The benchmark's folder."""
    unit: tyro.conf.Positional[str]
    """The unit's name, as the report lists it, or the beginning of it."""
    out: ResultsFolder
    force: ReplaceResults = False
    video: Video = True
    size: Size = (224, 224)


@dataclass(frozen=True)
class DoctorOptions(CommonOptions):
    """Examine this machine: what works, what is missing, what to do."""


@dataclass(frozen=True)
class ScenesOptions(CommonOptions):
    """List the scenes that have names, or tell what is in a scene, whether it can be, and how it looks.

    What cannot be built, lies in another thing, is in mid-air or not where the facts say is an error. A
    scene_k_info.json of Digital Cousins is furnished with models of the library.
    """

    scene: tyro.conf.Positional[Annotated[Maybe[str], READ_SCENE]] = None
    """Name of a scene, a scene's JSON file, or one of Digital Cousins."""
    check: Flag = False
    """Say all that is wrong with the scene, else what stands on or in what in it; the exit code is 2 or 0."""
    picture: Maybe[Path] = None
    """File for a picture of the scene, .png or .jpg; nothing is planned or moved. Needs a renderer."""
    schema: Flag = False
    """Print the JSON schema of scene files, for editors and other programs."""
    out: Maybe[Path] = None
    """File for the scene as this program reads it; its folder is made when absent."""
    force: ReplaceFile = False


@dataclass(frozen=True)
class BenchPhotoOptions(CommonOptions):
    """Measure how good reconstructions from photographs are, on rooms that are known.

    Rooms are drawn from a seed and seen by a camera; each track gives the reconstruction something else, and its title
    says what of that is taken from the simulator. Goes on where an earlier run with the same folder ended.
    """

    out: ResultsFolder
    rooms: int = 20
    """How many rooms of households: 102 of a seed, then of the next one."""
    kitchens: int = 0
    """How many kitchens of T1 to T4 beside them."""
    seed: int = 0
    """Of the rooms, the cameras and the noise."""
    track: Literal["A", "B", "C", "D", "E", "F", "G"] = "B"
    """A: clean depth, the simulator's masks (an upper bound). B: noisy depth and spoilt boxes. C: noisy depth alone.
    D: boxes and the camera's height, no depth. E: the same with depth as bent as a network's. F: noisy depth and what
    --detector finds. G: B with foreign shapes."""
    detector: Maybe[Path] = None
    """Of track F: folder with a detector's weights (docs/photo.md says which)."""
    transfer: Flag = False
    """Plan in the reconstructions and execute in the true rooms, with and without self-evolution."""


@dataclass(frozen=True)
class PhotoOptions(CommonOptions):
    """Reconstruct a room from a photograph, best with depth, as a scene of the library's models.

    What is seen in each box is explained by a model that is posed, sized and opened until its depths and colours are
    those of the picture. Exit code 1 means that physics refuses what came out, 2 that what was given cannot be used.
    """

    picture: tyro.conf.Positional[Annotated[Path, Read()]]
    """The picture (PNG, JPEG or another usual form), or a recording: a TUM folder, Record3D's .r3d or EXR export."""
    out: ResultsFolder
    photo_inputs: PhotoInputs = field(default_factory=PhotoInputs)
    model: Maybe[str] = None
    """Instead of --boxes: vision-language model that finds and names things, such as openai:gpt-5.2 or replay:FILE."""
    max_tokens: MaxTokens = None
    max_cost_usd: MaxCost = None
    max_time_s: MaxTime = None
    resume: GoOn = False
    force: ReplaceResults = False


@dataclass(frozen=True)
class AssetsOptions(CommonOptions):
    """List the models that a scene's objects can name, with their ranges."""

    sheet: Maybe[Path] = None
    """File for a picture of all of them, one variation each; needs a renderer."""
    seed: int = 0
    """Which variation the picture shows."""


@dataclass(frozen=True)
class ImportOptions(CommonOptions):
    """Make a model for scenes of a URDF, a PartNet-Mobility folder or a mesh, and tell what a robot can do with it."""

    source: tyro.conf.Positional[Annotated[Path, Read()]]
    """A .urdf file, a folder with mobility.urdf, or an OBJ, STL, PLY, glTF or DAE mesh."""
    name: Maybe[str] = None
    """Its name; scenes say imported/NAME. By default that of the source."""
    category: Maybe[str] = None
    """What it is, such as cabinet or mug; by default what the files say, else its name."""
    height_m: Maybe[float] = None
    """Its height in metres; by default the files' lengths are metres."""
    side: Maybe[Path] = None
    """JSON file with what overrules inference; by default affordances.json beside the source."""


@dataclass(frozen=True)
class CheckOptions(CommonOptions):
    """Examine BDDL files: what is wrong in them, and what is legal but suspicious.

    The exit code is 0 when nothing is wrong, 1 when something is, 2 when a file cannot be read.
    """

    files: BddlFiles
    profile: Profile = None
    strict: Flag = False
    """Count warnings as mistakes."""


@dataclass(frozen=True)
class FmtOptions(CommonOptions):
    """Lay out BDDL files anew; every word and every comment stays.

    The exit code is 0 when all is well, 1 when a file has mistakes or, with --check, another layout.
    """

    files: BddlFiles
    profile: Profile = None
    check: Flag = False
    """Change nothing; name the files that would change."""
    write: Flag = False
    """Write the files instead of printing them."""


BddlSubCommand = (
    Annotated[CheckOptions, tyro.conf.subcommand("check")] | Annotated[FmtOptions, tyro.conf.subcommand("fmt")]
)


@dataclass(frozen=True)
class BddlOptions:
    """Examine BDDL files, or lay them out anew."""

    command: BddlSubCommand


SubCommand = (
    Annotated[RunOptions, tyro.conf.subcommand("run")]
    | Annotated[PlanOptions, tyro.conf.subcommand("plan")]
    | Annotated[RolloutOptions, tyro.conf.subcommand("rollout")]
    | Annotated[EvolveOptions, tyro.conf.subcommand("evolve")]
    | Annotated[BenchOptions, tyro.conf.subcommand("bench")]
    | Annotated[GenerateOptions, tyro.conf.subcommand("generate")]
    | Annotated[DatasetOptions, tyro.conf.subcommand("dataset")]
    | Annotated[ReplayOptions, tyro.conf.subcommand("replay")]
    | Annotated[TrainOptions, tyro.conf.subcommand("train")]
    | Annotated[EvaluateOptions, tyro.conf.subcommand("evaluate")]
    | Annotated[BenchReplayOptions, tyro.conf.subcommand("bench-replay")]
    | Annotated[BenchPhotoOptions, tyro.conf.subcommand("bench-photo")]
    | Annotated[VerifyOptions, tyro.conf.subcommand("verify")]
    | Annotated[GraphOptions, tyro.conf.subcommand("graph")]
    | Annotated[RecheckOptions, tyro.conf.subcommand("recheck")]
    | Annotated[DoctorOptions, tyro.conf.subcommand("doctor")]
    | Annotated[ScenesOptions, tyro.conf.subcommand("scenes")]
    | Annotated[PhotoOptions, tyro.conf.subcommand("photo")]
    | Annotated[AssetsOptions, tyro.conf.subcommand("assets")]
    | Annotated[ImportOptions, tyro.conf.subcommand("assets-import")]
    | Annotated[BddlOptions, tyro.conf.subcommand("bddl")]
)
