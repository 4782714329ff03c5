"""`scene2demo train`: train a policy on stored demonstrations; resumes where an earlier run ended."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from executor.cli.errors import DONE, BadOption, check
from executor.cli.options import CommonOptions, Flag, Maybe, Read
from executor.cli.output import ERR, bar, counting, print_json, say, tell

if TYPE_CHECKING:
    from executor.learn.policy_record import PolicyRecord
    from executor.learn.settings import PolicySettings


@dataclass(frozen=True)
class Options(CommonOptions):
    """Train a policy on stored demonstrations; the same command goes on where an earlier one ended."""

    settings: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="SETTINGS", help_behavior_hint="(required)")]]
    """state, ensemble, rooms, cloud or paper, or a TOML file that says what the policy sees, does and consists of."""
    data: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="STORE...", help_behavior_hint="(required)"), Read()]
    """Stores of episodes, as `generate` makes them, or what was exported of them; successes are learned from."""
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
    """Begin again, and replace the policy that the folder has."""


def execute(options: Options) -> int:
    """Train a policy; return the exit code."""
    import torch

    from executor.cli.execution import check_seed
    from executor.data.formats.table import repeats_text
    from executor.learn.demonstrations import read_demonstrations
    from executor.learn.policy_record import PolicyRecord
    from executor.learn.training import Trainer, parameters

    settings = _settings(options)
    check(options.episodes is None or options.episodes > 0, "--episodes", options.episodes, "a number above 0")
    check(options.threads > 0, "--threads", options.threads, "a number above 0")
    check(options.device == "cpu" or torch.cuda.is_available(), "--device", options.device, "cpu, since no GPU is here")
    check(bool(options.data), "--data", "is empty", "folders that `generate` filled")
    check_seed(options.seed)
    torch.set_num_threads(options.threads)
    with counting("reading demonstrations", quiet=options.json):
        data = read_demonstrations(options.data, settings, options.episodes)
    record = PolicyRecord.of(settings, options.seed, data)
    _make_room(options, record)
    trainer = Trainer(options.out, record, data, options.device)
    size, begun = parameters(record.network()), trainer.step
    if not options.json:
        apart = f" ({data.takeovers} of them corrections)" if data.takeovers else ""
        known = f"{len(data.names)} demonstrations{apart}, {len(data)} moments; {size / 1e6:.2f} million parameters"
        tell(f"  {known}{f'; going on at step {begun}' if begun else ''}")
        if data.repeats:
            tell(f"  {repeats_text(data.repeats)}", style="yellow")
    steps, losses, last_shown = settings.training.steps, [], begun
    with bar("training", steps, done=begun, quiet=options.json) as show:

        def show_loss(step: int, loss: float) -> None:
            """Show a loss: on a terminal in the bar, else in a line every tenth of the training."""
            nonlocal last_shown
            losses.append(loss)
            show(step, f"loss {loss:.4f}")
            if not (options.json or ERR.is_terminal) and (step - last_shown >= steps / 10 or step == steps):
                tell(f"  step {step:6} of {steps}  loss {loss:.4f}")
                last_shown = step

        trainer.run(show_loss)
    left_out = {"repeats": [list(pair) for pair in data.repeats]}
    numbers = {"demonstrations": len(data.names), "moments": len(data), "parameters": size, "steps": trainer.step}
    loss = losses[-1] if losses else None
    if options.json:
        print_json({"ok": True, "exit_code": DONE, "policy": str(options.out), **numbers, "loss": loss, **left_out})
        return DONE
    say(
        f"{'trained':11} {trainer.step} steps on {len(data.names)} demonstrations"
        + (f", loss {loss:.4f}" if loss else "")
    )
    say(f"{'policy':11} {options.out}")
    return DONE


def _settings(options: Options) -> PolicySettings:
    from executor.learn.settings import read_settings, settings_of

    found = read_settings(options.settings)
    given = {"steps": options.steps, "keep_every": options.keep_every}
    overrides = {name: number for name, number in given.items() if number is not None}
    for name, number in overrides.items():
        check(number > 0, f"--{name.replace('_', '-')}", number, "a number above 0")
    content = found.model_dump(mode="json")
    return (
        settings_of({**content, "training": {**content["training"], **overrides}}, options.settings)
        if overrides
        else found
    )


def _make_room(options: Options, record: PolicyRecord) -> None:
    """Check that the folder is new, or holds the beginning of this policy."""
    from executor.learn.policy_record import ABOUT, read_record

    out = options.out
    if out.is_dir() and any(out.iterdir()) and not (out / ABOUT).exists():
        raise BadOption("--out", out, "a new folder, or one with a policy; this one has files of something else")
    if out.exists() and not out.is_dir():
        raise BadOption("--out", out, "a folder, not a file")
    if options.force:
        shutil.rmtree(out, ignore_errors=True)
    elif (out / ABOUT).exists() and read_record(out).key != record.key:
        raise BadOption("--out", out, "a policy of these settings, this data and this seed; --force begins again")
