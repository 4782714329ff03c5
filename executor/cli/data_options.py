"""Options of the sub-commands that make data sets, work with them, and train and evaluate policies.

One class a sub-command; its docstring and its fields' docstrings are the help.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from executor.cli.options import (
    READ_SCENE,
    CommonOptions,
    Flag,
    FullSize,
    KeepSizes,
    Maybe,
    Read,
    ReplaceFile,
    ReplaceResults,
    ResultsFolder,
)

View = Literal["global", "head", "wrist"]
Format = Literal["lerobot", "lerobot-v2.1", "robomimic", "zarr"]
Extra = Literal["depth", "segmentation", "point_cloud", "corrections"]
Axis = Literal["target", "surfaces", "lights", "cameras", "physics"]
Look = Literal["surfaces", "lights", "cameras"]
Channel = Literal["rgb", "depth", "segmentation"]
ALL_CHANNELS: tuple[Channel, ...] = ("rgb", "depth", "segmentation")
Channels = Annotated[tuple[Channel, ...], tyro.conf.arg(metavar="CHANNEL...", help_behavior_hint="(default: all)")]
Family = Literal["T1", "T2", "T3", "T4", "T5", "T6"]


@dataclass(frozen=True)
class GenerateOptions(CommonOptions):
    """Make demonstrations: a store of episodes, complete, replayable, and folded into the formats that trainers load.

    Goes on where an earlier run with the same folder ended. What is to be made may be said here or in a plan's file,
    which counts where both say it.
    """

    what: tyro.conf.Positional[
        Annotated[tuple[str, ...], tyro.conf.arg(metavar="T1..T6|QUERY|PLAN.yaml", help_behavior_hint="(required)")]
    ]
    """Families of the benchmark, a sentence (with --scene), or a YAML file that lists what to make."""
    out: ResultsFolder
    scene: Annotated[Maybe[str], READ_SCENE] = None
    """Name of a scene, or a scene's JSON file, that the sentence is about; t1 to t4: the kitchen that an episode's
    seed draws."""
    episodes: int = 20
    """How many episodes of each to make; those that fail are counted, and left out of data sets."""
    seed: int = 0
    """Seed of the first episode; the following ones count up."""
    workers: int = 2
    """How many processes; one that crashes costs its episode only."""
    vary: Annotated[tuple[Axis, ...], tyro.conf.arg(metavar="AXIS...", help_behavior_hint="")] = ()
    """What varies too: the target's size and heading, surfaces, lights, cameras, physics."""
    distractors: int = 0
    """Most things added to a scene that the task has nothing to do with."""
    noise_m: float = 0.0
    """Noise in what the hand is told, in metres; recorded actions are without it."""
    views: Annotated[tuple[View, ...], tyro.conf.arg(metavar="VIEW...", help_behavior_hint="")] = ()
    """Cameras to draw: global, head, wrist; by default none."""
    size: tuple[int, int] = (128, 128)
    """Width and height of the pictures."""
    channels: Channels = ALL_CHANNELS
    """What of each camera is kept: rgb, which always is, depth, segmentation."""
    rate_hz: float = 10.0
    """Samples a second of simulated time."""
    failures: Flag = False
    """Keep the motion of failed episodes too."""
    evolve: Flag = False
    """Revise the flows that fail; failed attempts with their corrections are kept as well."""
    flows: Literal["planned", "paper"] = "planned"
    """The offline planner's flows, or the paper's initial flows of T1 to T4, numbers verbatim."""
    keep_sizes: KeepSizes = False
    full_size: FullSize = False
    stances: int = 1
    """How many stances to plan wherever one is chosen, of which the one with the arm nearest to home is taken: then it
    follows from what is seen, and policies learn it more easily. 1 takes the one that the episode's seed gives."""
    limit_h: Maybe[float] = None
    """Hours after which to stop; episodes in flight are lost, and the same command goes on later."""
    limit_gb: Maybe[float] = None
    """Gigabytes that may be added before it stops."""
    limit_s: float = 900.0
    """Wall time that an episode may take before its process is ended."""
    shard: str = "1/1"
    """Which part of the episodes to make, such as 3/8; all parts may share a folder."""
    again: Flag = False
    """Make episodes once more whose process crashed, hung, or met a mistake of the program."""


@dataclass(frozen=True)
class ReplayOptions(CommonOptions):
    """Do demonstrations again, and count how many come out as they were.

    By default the robot is told what it was told, and the states have to be the same bit by bit; the exit code is 1
    when those of one are not. What was exported has no log of commands, but actions: `--through env`.
    (`scene2demo bench replay` runs one unit of a benchmark again, and shows it.)
    """

    store: tyro.conf.Positional[Annotated[Path, Read()]]
    """A store of episodes, as `generate` makes them, or a LeRobot data set that was exported of one."""
    through: Literal["log", "env"] = "log"
    """log: by the command log, exactly; env: by actions, through the Gymnasium environment, at the samples' rate."""
    actions: Literal["joint_target", "paper"] = "joint_target"
    """With --through env: what the actions are, absolute joint targets or the paper's ten numbers."""
    episodes: Maybe[int] = None
    """How many to do again, from the first on; by default all."""
    workers: int = 1
    """How many processes; one does them in this process."""


Store = tyro.conf.Positional[
    Annotated[
        Path,
        tyro.conf.arg(metavar="STORE", help="Folder that `generate` filled.", help_behavior_hint="(required)"),
        Read(),
    ]
]


@dataclass(frozen=True)
class ExportOptions(CommonOptions):
    """Fold the successes of a store into a data set that a trainer loads; the same store gives the same bytes."""

    store: Store
    out: ResultsFolder
    format: Format = "lerobot"
    """LeRobotDataset v3.0 or v2.1, robomimic's HDF5, or the zarr of Diffusion Policy and DP3."""
    include: Annotated[tuple[Extra, ...], tyro.conf.arg(metavar="WHAT...", help_behavior_hint="")] = ()
    """What is to be in it too: depth and segmentation (which all episodes have to have), point_cloud (of what is there,
    1,024 points), corrections (attempts that failed and were revised, as episodes of their own)."""
    only: Annotated[str, tyro.conf.arg(metavar="KEY=VALUE,...", help_behavior_hint="(default: all successes)")] = ""
    """Which episodes, such as origin=T5+T6,views=head: origin, ended (succeeded, failed), rate, robot, size (128x128),
    channels (depth, segmentation), and views, which are all that the data set has then (none: no pictures)."""
    force: ReplaceResults = False


@dataclass(frozen=True)
class RenderOptions(CommonOptions):
    """Draw the pictures of a store anew into another store, from its states and without simulating.

    Goes on where an earlier run with the same folder ended; the same request gives the same bytes.
    """

    store: Store
    out: ResultsFolder
    views: Annotated[tuple[View, ...], tyro.conf.arg(metavar="VIEW...", help_behavior_hint="(default: all)")] = (
        "global",
        "head",
        "wrist",
    )
    """Cameras to draw: global, head, wrist."""
    size: tuple[int, int] = (128, 128)
    """Width and height of the pictures."""
    channels: Channels = ALL_CHANNELS
    """What of each camera is kept: rgb, which always is, depth, segmentation."""
    vary: Annotated[tuple[Look, ...], tyro.conf.arg(metavar="AXIS...", help_behavior_hint="")] = ()
    """What varies: surfaces, lights, cameras; as in `generate`."""
    seed: int = 0
    """Which look is drawn of what varies; 0 is the one that `generate` draws."""
    workers: int = 2
    """How many processes."""
    limit_s: float = 900.0
    """Wall time that an episode may take before its process is ended."""


@dataclass(frozen=True)
class InfoOptions(CommonOptions):
    """Tell what a store has: yield, failures, durations and bytes, by origin."""

    store: Store


@dataclass(frozen=True)
class CheckStoreOptions(CommonOptions):
    """Read every episode of a store, and name what is wrong; the exit code is 1 when something is."""

    store: Store


@dataclass(frozen=True)
class MergeOptions(CommonOptions):
    """Put the episodes of several stores into one; what both have is there once."""

    stores: tyro.conf.Positional[
        Annotated[
            tuple[Path, ...],
            tyro.conf.arg(metavar="STORE...", help="Folders that `generate` filled.", help_behavior_hint="(required)"),
            Read(),
        ]
    ]
    out: ResultsFolder


@dataclass(frozen=True)
class CardOptions(CommonOptions):
    """Write the page that goes with a data set: what is in it, how it was made, its yield."""

    store: Store
    out: Maybe[Path] = None
    """A Markdown file; by default the page is printed."""
    force: ReplaceFile = False


DatasetSubCommand = (
    Annotated[ExportOptions, tyro.conf.subcommand("export")]
    | Annotated[RenderOptions, tyro.conf.subcommand("render")]
    | Annotated[InfoOptions, tyro.conf.subcommand("info")]
    | Annotated[CheckStoreOptions, tyro.conf.subcommand("check")]
    | Annotated[MergeOptions, tyro.conf.subcommand("merge")]
    | Annotated[CardOptions, tyro.conf.subcommand("card")]
)


@dataclass(frozen=True)
class DatasetOptions:
    """Fold a store of demonstrations into formats, look through it, merge it."""

    command: DatasetSubCommand


@dataclass(frozen=True)
class TrainOptions(CommonOptions):
    """Train a policy on stored demonstrations; the same command goes on where an earlier one ended."""

    settings: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="SETTINGS", help_behavior_hint="(required)")]]
    """state, ensemble, rooms, cloud or paper, or a TOML file that says what the policy sees, does and consists of."""
    data: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="STORE...", help_behavior_hint="(required)"), Read()]
    """Stores of episodes, as `generate` makes them, or LeRobot data sets that were exported of them; successes are
    learned from."""
    out: Path
    """Folder for the policy."""
    episodes: Maybe[int] = None
    """How many demonstrations of each store, from the first on; by default all."""
    steps: Maybe[int] = None
    """How many steps to train, instead of what the settings say."""
    keep_every: Maybe[int] = None
    """Keep the weights after every so many steps too, for `evaluate --steps` to judge and choose by rollouts."""
    seed: int = 0
    """Of the first weights, of batches and noise."""
    device: Literal["cpu", "cuda"] = "cpu"
    """What computes."""
    threads: int = 2
    """How many threads the CPU's part has; other numbers round otherwise."""
    force: Flag = False
    """Begin anew, and replace the policy that the folder has."""


@dataclass(frozen=True)
class EvaluateOptions(CommonOptions):
    """Have policies act in the environment, all of them in the same episodes, and count what comes of it."""

    policies: tyro.conf.Positional[
        Annotated[
            tuple[Path, ...],
            tyro.conf.arg(
                metavar="POLICY...",
                help="Folders that `train` filled, or policies of LeRobot (its `pretrained_model`).",
                help_behavior_hint="(required)",
            ),
            Read(),
        ]
    ]
    task: Maybe[Family] = None
    """A family of the benchmark; by default what the policies were trained on."""
    data: Maybe[Path] = None
    """The data set that policies of LeRobot were trained on, or its store; ours say it themselves."""
    episodes: int = 50
    """How many episodes."""
    seed: int = 0
    """Seed of the first episode, one that no demonstration has; the following ones count up."""
    execute: Maybe[int] = None
    """How many actions of a chunk are done before a policy looks again; by default what its settings say."""
    steps: Annotated[tuple[int, ...], tyro.conf.arg(metavar="STEP...", help_behavior_hint="")] = ()
    """The weights after so many steps of training, where they were kept, each as a policy; by default the last."""
    out: Maybe[Path] = None
    """Folder for results: evaluation.json and evaluation.html, and with --videos the videos."""
    videos: Flag = False
    """Draw a video of every failure."""
    size: tuple[int, int] = (320, 240)
    """Width and height of the videos."""
    threads: int = 1
    """How many threads a network has."""
