"""`scene2demo train`: train a policy on stored demonstrations; resumes where an earlier run ended."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import torch
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from executor.cli.data_options import TrainOptions
from executor.cli.errors import DONE, BadOption, check
from executor.cli.execution import check_seed
from executor.cli.output import ERR, counting, print_json, say, tell
from executor.data.formats.table import repeats_text
from executor.learn.demonstrations import read_demonstrations
from executor.learn.policy_record import ABOUT, PolicyRecord, read_record
from executor.learn.settings import PolicySettings, read_settings, settings_of
from executor.learn.training import LossCallback, Trainer, parameters


def execute(options: TrainOptions) -> int:
    """Train a policy; return the exit code.

    Raises:
        SettingsError, NotADataset, NothingToExport, NotAPolicy, BadOption: Something that was named cannot be used.
    """
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
    losses: list[float] = []
    with _progress(settings.training.steps, begun, quiet=options.json) as show_loss:

        def listen(step: int, loss: float) -> None:
            losses.append(loss)
            show_loss(step, loss)

        trainer.run(listen)
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


def _settings(options: TrainOptions) -> PolicySettings:
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


def _make_room(options: TrainOptions, record: PolicyRecord) -> None:
    """Check that the folder is new, or holds the beginning of this policy.

    Raises:
        BadOption: It holds something else.
        NotAPolicy: What it holds cannot be read.
    """
    out = options.out
    if out.is_dir() and any(out.iterdir()) and not (out / ABOUT).exists():
        raise BadOption("--out", out, "a new folder, or one with a policy; this one has files of something else")
    if out.exists() and not out.is_dir():
        raise BadOption("--out", out, "a folder, not a file")
    if options.force:
        shutil.rmtree(out, ignore_errors=True)
    elif (out / ABOUT).exists() and read_record(out).key != record.key:
        raise BadOption("--out", out, "a policy of these settings, this data and this seed; --force begins anew")


@contextmanager
def _progress(steps: int, begun: int, *, quiet: bool) -> Iterator[LossCallback]:
    """Provide a callback for the loss that shows it: on a terminal a bar, else a line every tenth of the training."""
    if quiet:
        yield lambda step, loss: None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=ERR, disable=not ERR.is_terminal) as bar:
        task = bar.add_task("training", total=steps, completed=begun)
        last_shown = begun

        def show(step: int, loss: float) -> None:
            nonlocal last_shown
            bar.update(task, completed=step, description=f"loss {loss:.4f}")
            if not ERR.is_terminal and (step - last_shown >= steps / 10 or step == steps):
                tell(f"  step {step:6} of {steps}  loss {loss:.4f}")
                last_shown = step

        yield show
