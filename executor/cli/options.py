"""Options that several sub-commands have: types of fields, each with its help.

A `Flag` is given or not, such as `--json`. A `Maybe` may be left out and then has no value. `negated_flag` is for
what is on by default and is taken back, such as `--no-video`: the help describes the option, not the field.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import tyro

T = TypeVar("T")


@dataclass(frozen=True)
class Read:
    """Mark for an option or positional argument that names an input file; the parser ignores it.

    Attributes:
        what: Its kind, as in its reader's messages; empty where these begin with the path.
        named: Whether it may be a name as well: then it is a path if it ends in `.json` or has a folder in it.
    """

    what: str = ""
    named: bool = False


# Hide defaults of flags and of optional values in `--help`.
_NO_HINT = tyro.conf.arg(help_behavior_hint="")

Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff, _NO_HINT]
Maybe = Annotated[T | None, _NO_HINT]


def option_help(text: str) -> object:
    """Return the help of a shared option."""
    return tyro.conf.arg(help=text)


def negated_flag(does: str) -> object:
    """Return the setting of a flag that is true by default and becomes an option `--no-...`.

    Args:
        does: What the option does, as a sentence for the help.
    """
    return tyro.conf.arg(help=does, help_behavior_hint="")


Json = Annotated[Flag, option_help("Print one JSON object on standard output.")]
Debug = Annotated[Flag, option_help("Show the traceback of an unexpected error.")]
ReplaceFile = Annotated[Flag, option_help("Replace the file when it exists.")]
ReplaceResults = Annotated[
    Flag, option_help("Replace results that the folder already has; what a model answered is kept under another name.")
]
GoOn = Annotated[
    Flag,
    option_help("Go on from a run that ended early: what its model answered is not asked again, and what failed is."),
]
KeepSizes = Annotated[
    Flag, option_help("Scale nothing to the gripper; what it cannot take at its own size is refused.")
]
FullSize = Annotated[
    Flag, option_help("Another word for --robot panda: full size, a hand that opens to 80 mm, and no lift.")
]
# A test holds these against the records; reading them here would make every `--help` load the graph.
RobotName = Annotated[
    Maybe[Literal["paper", "panda", "panda-lift", "ur5-lift"]],
    option_help(
        "Which robot: the paper's Panda of 0.7 of its size, one of full size (what --full-size says too), that on a "
        "lift, or a UR5 with a parallel gripper on one. By default the scene's; a file that names none is for the "
        "Panda on a lift, and T1 to T6 have the paper's."
    ),
]
RepairScene = Annotated[
    Maybe[Literal["scene"]],
    option_help(
        "Where the sentence has no proved and feasible plan, change the scene as little as possible until it has: put "
        "things elsewhere, open or shut doors, remove what is in the way. Every episode says what was changed."
    ),
]
Video = Annotated[Flag, negated_flag("Draw no pictures and no video.")]
Size = Annotated[
    tuple[int, int], option_help("Width and height of the robot's views; the overview is drawn twice as large.")
]
ResultsFolder = Annotated[Path, option_help("Folder for the results.")]
EpisodesFolder = Annotated[Maybe[Path], option_help("Folder for results: one folder an episode, named by its seed.")]
FirstSeed = Annotated[int, option_help("Seed of the first episode; the following ones count up.")]
Episodes = Annotated[int, option_help("How many episodes to run.")]
Limit = Annotated[int, option_help("How many revisions a subtask may have.")]
READ_SCENE = Read("scene", named=True)
SceneName = Annotated[
    str, option_help("Name of a scene that comes with the package, or a scene's JSON file."), READ_SCENE
]
OptionalScene = Annotated[
    Maybe[str],
    option_help(
        "Name of a scene or a scene's JSON file; by default `<task>_scene.json` or `scene.json` in its folder."
    ),
    READ_SCENE,
]
DomainFile = Annotated[
    Maybe[Path],
    option_help(
        "TOML file of an own domain: its predicates, kinds and primitives count in addition to the 21, or without them."
    ),
    Read("domain"),
]
TaskFile = tyro.conf.Positional[Annotated[Path, option_help("The task's JSON file."), Read("task")]]
TaskToRun = tyro.conf.Positional[
    Annotated[
        Path, option_help("The task's JSON file; numbers in its flows are run as they are written."), Read("task")
    ]
]


def _sentence(words: list[str]) -> str:
    if not words:
        raise ValueError('a sentence is missing, such as "put the glass into the refrigerator"')
    return " ".join(words)


Sentence = tyro.conf.Positional[
    Annotated[
        str,
        tyro.conf.arg(
            help='What the robot is to do, such as "put the glass into the refrigerator".',
            help_behavior_hint="(required)",
        ),
        # Without quotes a shell passes the words one by one.
        tyro.constructors.PrimitiveConstructorSpec(
            nargs="*",
            metavar="QUERY",
            instance_from_str=_sentence,
            is_instance=lambda value: isinstance(value, str),
            str_from_instance=lambda value: [value],
        ),
    ]
]
OptionalSentence = tyro.conf.Positional[
    Annotated[
        str,
        tyro.conf.arg(
            help='What the robot is to do, such as "put the glass into the refrigerator".',
            help_behavior_hint="",
        ),
        # Without quotes a shell passes the words one by one.
        tyro.constructors.PrimitiveConstructorSpec(
            nargs="*",
            metavar="QUERY",
            instance_from_str=" ".join,
            is_instance=lambda value: isinstance(value, str),
            str_from_instance=lambda value: [value],
        ),
    ]
]
MaxTokens = Annotated[Maybe[int], option_help("Most tokens that the model may use.")]
MaxCost = Annotated[Maybe[float], option_help("Most US dollars that the model may cost, where its price is known.")]
MaxTime = Annotated[Maybe[float], option_help("Most seconds that the model may take.")]
Models = Annotated[
    tuple[str, ...],
    tyro.conf.UseAppendAction,
    tyro.conf.arg(
        metavar="WHO=MODEL",
        help="With --model: another one for a module, 1 to 5, or for the inspector or supervisor; may be given several "
        "times.",
        help_behavior_hint="",
    ),
]
ModelsThatPlan = Annotated[
    tuple[str, ...],
    tyro.conf.UseAppendAction,
    tyro.conf.arg(
        metavar="WHO=MODEL",
        help="With --model: another one for a module, 1 to 5; may be given several times.",
        help_behavior_hint="",
    ),
]
Temperature = Annotated[
    Maybe[float], option_help("Temperature at which the model draws its words, where it takes one; by default its own.")
]
ModelSeed = Annotated[Maybe[int], option_help("Seed from which the model draws its words; some servers ignore it.")]
BddlFiles = tyro.conf.Positional[
    Annotated[
        tuple[str, ...],
        tyro.conf.arg(
            metavar="FILE...",
            help="Files, folders with files that end in .bddl, or - for the standard input.",
            help_behavior_hint="(required)",
        ),
    ]
]
Profile = Annotated[
    str | None,
    tyro.conf.arg(
        metavar="NAME",
        help="The dialect: scene, behavior, behavior-compat or libero; by default the one that the file's domain "
        "belongs to.",
        help_behavior_hint="",
    ),
]
Family = Literal["T1", "T2", "T3", "T4", "T5", "T6"]
BenchFamily = Literal["T1", "T2", "T3", "T4", "T5", "T6", "T7"]
View = Literal["global", "head", "wrist"]
Axis = Literal["target", "surfaces", "lights", "cameras", "physics"]
Plain = Annotated[
    Flag,
    option_help(
        "Draw assets in their own colours on a chequered floor, without the home: its style, walls and daylight."
    ),
]
Channel = Literal["rgb", "depth", "segmentation"]
ALL_CHANNELS: tuple[Channel, ...] = ("rgb", "depth", "segmentation")
Channels = Annotated[tuple[Channel, ...], tyro.conf.arg(metavar="CHANNEL...", help_behavior_hint="(default: all)")]


@dataclass(frozen=True, kw_only=True)
class CommonOptions:
    """What every command takes."""

    json: Json = False
    debug: Debug = False


@dataclass(frozen=True)
class PhotoInputs:
    """What is given with a photograph."""

    boxes: Maybe[Path] = None
    """With a photograph: boxes with names; COCO, LabelMe or own JSON, or YOLO's .txt with its classes.txt."""
    detector: Maybe[Path] = None
    """Instead of --boxes: folder with a detector's weights, such as Grounding DINO's (docs/photo.md says which)."""
    least_score: Maybe[float] = None
    """With --detector: how sure it has to be of a box, 0 to 1; by default what is usual for it."""
    names: Maybe[str] = None
    """With --detector or --model: what is looked for, such as "mug, bowl"; by default all that the library has."""
    mask_model: Maybe[Path] = None
    """Folder with the weights of a network that finds the pixels of each box, such as SAM 2's."""
    depth: Maybe[Path] = None
    """Its depth, pixel by pixel: a 16-bit PNG in millimetres, .npy, .npz or .exr; a recording has its own."""
    depth_model: Maybe[Path] = None
    """Instead of --depth: folder with the weights of a network that guesses depths in metres."""
    camera: Maybe[str] = None
    """hfov=DEGREES, vfov=DEGREES or a JSON file with fx, fy, cx, cy or K; by default what the picture's EXIF says."""
    depth_unit_m: Maybe[float] = None
    """What one step of the depth's numbers is in metres, such as 0.0002 for the TUM sets."""
    frame: Maybe[int] = None
    """Which picture of a recording, counted from 0; by default the one in the middle."""
    tilt: Maybe[float] = None
    """How far the camera looks down in degrees; a picture without depth needs it."""
    roll: Maybe[float] = None
    """With --tilt: by how many degrees the vertical leans to the right in the picture; 0 by default."""
    camera_height_m: Maybe[float] = None
    """How high above the floor the camera was; scales a picture without depth, and guessed depth."""
    depth_kind: Maybe[Literal["measured", "guessed"]] = None
    """Who made the --depth: a sensor (the default), or a network that guessed it from the picture."""


@dataclass(frozen=True, kw_only=True)
class ModelOptions:
    """A language model, how it samples, and its budget."""

    model: Maybe[str] = None
    """Language model that plans, such as openai:gpt-5.2, ollama:qwen3-vl or replay:FILE; by default none does.
    replay:FILE,openai:gpt-5.2 goes on with the model where the recording ends."""
    models: Models = ()
    temperature: Temperature = None
    model_seed: ModelSeed = None
    max_tokens: MaxTokens = None
    max_cost_usd: MaxCost = None
    max_time_s: MaxTime = None


@dataclass(frozen=True, kw_only=True)
class CampaignModelOptions(ModelOptions):
    """A language model that plans the units of a campaign, which measurements judge."""

    models: ModelsThatPlan = ()


@dataclass(frozen=True)
class JudgeOptions(ModelOptions):
    """Who judges the steps of a failed attempt and revises its flow."""

    model: Maybe[str] = None
    """Language model that judges and revises, such as openai:gpt-5.2 or replay:FILE; by default measurements do."""
    views: str = "global,head,wrist"
    """Cameras whose pictures the model sees, with commas between them; none: it gets measurements only."""
    look_back: int = 1
    """How many steps before the judged one the model sees as well."""
    inspect: Literal["all", "faulty"] = "all"
    """Which steps the model is asked about: all, or those that measurements find faulty or cannot tell."""
    measurements: Annotated[Flag, negated_flag("Show the model pictures only, and not what was measured.")] = True
    most_pictures: Maybe[int] = None
    """Most pictures in a question; by default 36 for a step, 24 for a revision."""
