"""What can be typed to the sub-commands that train policies, judge them and put them right."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from executor.cli.words.datasets import Family
from executor.cli.words.shared import CommonOptions, Flag, Maybe, ResultsFolder

Pushed = Literal["base", "item"]


@dataclass(frozen=True)
class TrainOptions(CommonOptions):
    """Train a policy on stored demonstrations; the same command goes on where an earlier one ended."""

    settings: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="SETTINGS", help_behavior_hint="(required)")]]
    """state, cloud or paper, or a TOML file that says what the policy sees, does and consists of."""
    data: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="STORE...", help_behavior_hint="(required)")]
    """Stores of episodes, as `generate` makes them, or what was exported of them; successes are learned from."""
    out: Path
    """Folder for the policy."""
    episodes: Maybe[int] = None
    """How many demonstrations of each store, from the first on; by default all."""
    steps: Maybe[int] = None
    """How many steps to train, instead of what the settings say."""
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
            tyro.conf.arg(metavar="POLICY...", help="Folders that `train` filled.", help_behavior_hint="(required)"),
        ]
    ]
    task: Maybe[Family] = None
    """A family of the benchmark; by default what the policies were trained on."""
    episodes: int = 50
    """How many episodes."""
    seed: int = 0
    """Seed of the first episode, one that no demonstration has; the following ones count up."""
    execute: Maybe[int] = None
    """How many actions of a chunk are done before a policy looks again; by default what its settings say."""
    steps: Annotated[tuple[int, ...], tyro.conf.arg(metavar="STEP...", help_behavior_hint="")] = ()
    """The weights after so many steps of training, where they were kept, each as a policy; by default the last."""
    push: Annotated[tuple[Pushed, ...], tyro.conf.arg(metavar="base|item...", help_behavior_hint="")] = ()
    """What is pushed once in the middle of each episode: the robot's base by 5 cm, the item by 3 cm."""
    fallback: Flag = False
    """Where a policy gets no further, have the planner go on with a proved plan; it is counted apart."""
    out: Maybe[Path] = None
    """Folder for results: evaluation.json and evaluation.html, and with --videos the videos."""
    videos: Flag = False
    """Draw a video of every failure."""
    size: tuple[int, int] = (320, 240)
    """Width and height of the videos."""
    threads: int = 1
    """How many threads a network has."""


@dataclass(frozen=True)
class CorrectOptions(CommonOptions):
    """Have a policy act, and the planner go on with a proved plan from where it comes to: demonstrations into a store.

    In half of the episodes that the policy fails, the planner takes over where it stalled; else at a moment of its way
    that the episode's seed draws. Train on the store beside others. Goes on where an earlier run with the same folder
    ended.
    """

    policy: tyro.conf.Positional[
        Annotated[
            Path, tyro.conf.arg(metavar="POLICY", help="Folder that `train` filled.", help_behavior_hint="(required)")
        ]
    ]
    out: ResultsFolder
    task: Maybe[Family] = None
    """A family of the benchmark; by default what the policy was trained on."""
    episodes: int = 50
    """How many episodes."""
    seed: int = 0
    """Seed of the first episode; the following ones count up."""
    execute: Maybe[int] = None
    """How many actions of a chunk are done before the policy looks again; by default what its settings say."""
    step: Maybe[int] = None
    """The weights after so many steps of training, where they were kept; by default the last."""
    noise_m: float = 0.0
    """Noise in what the planner tells the hand, in metres; recorded actions are without it."""
    workers: int = 2
    """How many processes; one that crashes costs its episode only."""
    limit_s: float = 900.0
    """Wall time that an episode may take before its process is ended."""
