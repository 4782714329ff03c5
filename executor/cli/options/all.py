"""All sub-commands: one class each, from the files beside this one that have what can be typed to them.

Nothing but the standard library and tyro is loaded to read them.
"""

from __future__ import annotations

from typing import Annotated

import tyro

from executor.cli.options.bddl import Bddl, Check, Fmt
from executor.cli.options.evolution import Ablate, Evolve
from executor.cli.options.plan import Graph, Recheck, Verify
from executor.cli.options.running import Bench, Replay, Rollout, Run
from executor.cli.options.stock import Assets, Doctor, ImportAsset, Scenes

Options = (
    Run
    | Rollout
    | Evolve
    | Ablate
    | Bench
    | Replay
    | Verify
    | Graph
    | Recheck
    | Doctor
    | Scenes
    | Assets
    | ImportAsset
    | Check
    | Fmt
)
SubCommand = (
    Annotated[Run, tyro.conf.subcommand("run")]
    | Annotated[Rollout, tyro.conf.subcommand("rollout")]
    | Annotated[Evolve, tyro.conf.subcommand("evolve")]
    | Annotated[Ablate, tyro.conf.subcommand("ablate")]
    | Annotated[Bench, tyro.conf.subcommand("bench")]
    | Annotated[Replay, tyro.conf.subcommand("bench-replay")]
    | Annotated[Verify, tyro.conf.subcommand("verify")]
    | Annotated[Graph, tyro.conf.subcommand("graph")]
    | Annotated[Recheck, tyro.conf.subcommand("recheck")]
    | Annotated[Doctor, tyro.conf.subcommand("doctor")]
    | Annotated[Scenes, tyro.conf.subcommand("scenes")]
    | Annotated[Assets, tyro.conf.subcommand("assets")]
    | Annotated[ImportAsset, tyro.conf.subcommand("assets-import")]
    | Annotated[Bddl, tyro.conf.subcommand("bddl")]
)
