"""`scene2demo dataset export|render|info|check|audit|merge|card`: work with a filled store of demonstrations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from bddl.terminal import pluralize
from executor.cli.errors import DONE, FAILED, INTERRUPTED, BadOption, check
from executor.cli.options import (
    ALL_CHANNELS,
    Channels,
    CommonOptions,
    Flag,
    Maybe,
    Plain,
    Read,
    ReplaceFile,
    ReplaceResults,
    ResultsFolder,
    View,
    negated_flag,
)
from executor.cli.output import counting, print_json, print_text, say, tell
from executor.system.files import write_text

if TYPE_CHECKING:
    from executor.data.formats.table import EpisodeStream
    from executor.data.rerender import RerenderSettings
    from executor.data.units import DemoUnit


Format = Literal["lerobot", "lerobot-v2.1", "robomimic", "zarr"]
Extra = Literal["depth", "segmentation", "point_cloud", "corrections"]
Look = Literal["surfaces", "lights", "cameras"]
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
    """Redraw the pictures of a store into another store, from its states and without simulating.

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
    plain: Plain = False
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
class AuditOptions(CommonOptions):
    """Decide again whether each episode succeeded, by a second geometry that uses no detector of the goal check.

    Start, end, the three seconds after it, sentence, plan, assets and commands are checked too. Verdicts are kept in
    the store, and exported as `audited`; the exit code is 1 when an episode is not what it says.
    """

    store: Store
    workers: int = 2
    """How many processes."""
    replay: Annotated[Flag, negated_flag("Do not repeat the recorded commands, which takes most of the time.")] = True
    again: Flag = False
    """Audit once more what was audited already and has not changed."""


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


SubCommand = (
    Annotated[ExportOptions, tyro.conf.subcommand("export")]
    | Annotated[RenderOptions, tyro.conf.subcommand("render")]
    | Annotated[InfoOptions, tyro.conf.subcommand("info")]
    | Annotated[CheckStoreOptions, tyro.conf.subcommand("check")]
    | Annotated[AuditOptions, tyro.conf.subcommand("audit")]
    | Annotated[MergeOptions, tyro.conf.subcommand("merge")]
    | Annotated[CardOptions, tyro.conf.subcommand("card")]
)


@dataclass(frozen=True)
class Options:
    """Fold a store of demonstrations into formats, look through it, merge it."""

    command: SubCommand


def execute(options: SubCommand) -> int:
    """Run the requested sub-command on a store; return the exit code."""
    from executor.data.formats.selection import Selection
    from executor.data.formats.store_reader import stream_of
    from executor.data.store import EpisodeStore

    match options:
        case ExportOptions():
            _check_apart(options.out, options.store)
            only = Selection.parse(options.only)
            return _write(stream_of(EpisodeStore.open(options.store), options.include, only), options)
        case RenderOptions():
            return _render(options)
        case InfoOptions():
            return _info(options)
        case CheckStoreOptions():
            return _check(options)
        case AuditOptions():
            return _audit(options)
        case MergeOptions():
            return _merge(options)
        case CardOptions():
            return _card(options)


def _check_apart(out: Path, source: Path) -> None:
    """Refuse an output where --force would delete the input, or that would become part of it."""
    where, read = out.resolve(), source.resolve()
    apart = not (where.is_relative_to(read) or read.is_relative_to(where))
    check(apart, "--out", out, f"another folder than STORE, neither around it nor within it ({source})")


def _write(stream: EpisodeStream, options: ExportOptions) -> int:
    from executor.data.formats.export import write_set
    from executor.data.formats.table import repeats_text

    with counting("writing episodes", quiet=options.json) as progress:
        found = write_set(stream, options.format, options.out, overwrite=options.force, on_progress=progress)
    numbers = {"train": found.train, "validation": found.validation, "corrections": found.corrections}
    pictures = {"views": list(found.views), "channels": list(found.channels)}
    if options.json:
        head = {"ok": True, "out": str(options.out), "format": options.format}
        left_out = {"repeats": [list(pair) for pair in found.repeats]}
        print_json({**head, "episodes": numbers, **pictures, "rate_hz": found.rate_hz, **left_out})
        return DONE
    if found.repeats:
        tell(repeats_text(found.repeats), style="yellow")
    words = f"{pluralize(found.train + found.validation, 'demonstration')}, {found.validation} of them for validation"
    say(f"{'written':11} {words}, at {found.rate_hz:g} Hz", style="bold")
    if found.corrections:
        say(f"{'corrections':11} {pluralize(found.corrections, 'failed attempt')} with what was done about them")
    kinds = f", with {' and '.join(found.channels)}" if found.channels else ""
    say(f"{'views':11} {', '.join(found.views) or 'none'}{kinds}")
    say(f"{'data set':11} {options.out}")
    return DONE


def _info(options: InfoOptions) -> int:
    from executor.cli.commands.generate import yield_text
    from executor.data.card import contents_of, shares
    from executor.data.store import EpisodeStore

    found = contents_of(EpisodeStore.open(options.store))
    if options.json:
        print_json({"ok": True, "store": str(options.store), **found.to_json()})
        return DONE
    say(f"{'episodes':11} {found.made} made of {found.asked} asked for, {found.kept} to export", style="bold")
    if found.repeats:
        say(f"{'repeated':11} {pluralize(found.repeats, 'demonstration')} more, as `dataset check` lists them")
    say(f"{'yield':11} {yield_text(found.succeeded, found.made)}")
    for label, part in sorted(found.parts.items()):
        long = f", {part.simulated_s / part.kept:.1f} s each" if part.kept else ""
        say(f"{label:11} {part.succeeded} of {part.made} succeeded{long}")
    for kind, count in found.failures.most_common():
        say(f"{'failed':11} {count} x {kind}")
    if found.audited:
        say(f"{'audited':11} {', '.join(f'{count} {word}' for word, count in found.audited.most_common())}")
    say(f"{'samples':11} {found.samples} at {', '.join(f'{rate:g}' for rate in sorted(found.rates_hz)) or '-'} Hz")
    say(f"{'views':11} {shares(found.views, found.kept)}")
    each = f", {found.store_bytes / max(found.kept, 1) / 1000:.0f} kB a demonstration" if found.kept else ""
    say(f"{'size':11} {found.store_bytes / 1e6:.1f} MB{each}")
    return DONE


def _check(options: CheckStoreOptions) -> int:
    from executor.data.store import EpisodeStore
    from executor.data.upkeep import find_flaws

    store, wrong, looked_at = EpisodeStore.open(options.store), [], 0

    with counting("reading episodes", quiet=options.json) as progress:

        def counted_here(done: int, total: int) -> None:
            nonlocal looked_at
            looked_at = done + 1
            progress(done, total)

        for flaw in find_flaws(store, counted_here):
            wrong.append(flaw)
            if not options.json:
                say(f"{flaw.episode}: {flaw.what}", style="red")
    code = FAILED if wrong else DONE
    if options.json:
        listed = [{"episode": flaw.episode, "what": flaw.what} for flaw in wrong]
        print_json({"ok": not wrong, "exit_code": code, "episodes": looked_at, "flaws": listed})
    else:
        words = pluralize(len(wrong), "flaw") if wrong else "nothing wrong"
        tell(f"{pluralize(looked_at, 'episode')} read, {words}", style="red" if wrong else None)
    return code


def _audit(options: AuditOptions) -> int:
    from executor.audit.episodes import EpisodeVerdict, audit_store, count_kinds
    from executor.campaign.rate import Rate
    from executor.cli.execution import check_workers, command_line
    from executor.data.store import EpisodeStore

    check_workers(options.workers)
    store, found = EpisodeStore.open(options.store), list[EpisodeVerdict]()
    interrupted = False
    with counting("auditing episodes", quiet=options.json) as progress:
        verdicts = audit_store(
            store, with_replay=options.replay, workers=options.workers, again=options.again, on_progress=progress
        )
        try:
            for verdict in verdicts:
                found.append(verdict)
                for finding in () if options.json else verdict.findings:
                    tell(f"{verdict.episode}: {finding.kind}: {finding.text}", style="red")
        except KeyboardInterrupt:
            interrupted = True
    sound = sum(verdict.verdict == "sound" for verdict in found)
    left_out = sum(1 for _ in store.episodes()) - len(found)
    code = INTERRUPTED if interrupted else DONE if sound == len(found) else FAILED
    kinds = dict(count_kinds(found).most_common())
    if options.json:
        counts = {"audited": len(found), "sound": sound, "left_out": left_out, "kinds": kinds}
        listed = [verdict.to_json() for verdict in sorted(found, key=lambda each: each.episode) if verdict.findings]
        print_json({"ok": code == DONE, "exit_code": code, "store": str(store.path), **counts, "episodes": listed})
        return code
    say(
        f"{'audited':11} {Rate(sound, len(found)).counted('episodes sound')}",
        style="bold" if code == DONE else "yellow",
    )
    for kind, count in kinds.items():
        say(f"{'found':11} {count} x {kind}")
    if left_out and not interrupted:
        say(f"{'left out':11} {pluralize(left_out, 'episode')} whose motion was not kept")
    if interrupted:
        tell("scene2demo: interrupted; verdicts are kept, the same command goes on", style="yellow")
    elif sound:
        chosen = None if sound == len(found) else "audited=sound"
        say(f"{'next':11} {command_line('dataset export', options.store, only=chosen, out='FOLDER')}")
    return code


def _merge(options: MergeOptions) -> int:
    from executor.data.store import EpisodeStore
    from executor.data.upkeep import merge

    check(len(options.stores) > 0, "STORE", "is missing", "folders that generate filled")
    if options.out.resolve() in {path.resolve() for path in options.stores}:
        raise BadOption("--out", options.out, "another folder than those that are merged")
    stores = [EpisodeStore.open(path) for path in options.stores]
    with counting("merging stores", quiet=options.json) as progress:
        done = merge(stores, options.out, progress)
    if options.json:
        print_json({"ok": True, "out": str(options.out), "copied": done.copied, "same": done.same})
    else:
        say(f"{'copied':11} {pluralize(done.copied, 'episode')}, {done.same} were there already")
        say(f"{'store':11} {options.out}")
    return DONE


def _card(options: CardOptions) -> int:
    from executor.data.card import card, page
    from executor.data.store import EpisodeStore

    text = card(page(EpisodeStore.open(options.store)))
    if options.out is None:
        if options.json:
            print_json({"ok": True, "card": text})
        else:
            print_text(text)
        return DONE
    check(options.force or not options.out.exists(), "--out", options.out, "a file that is not there yet, or --force")
    write_text(options.out, text)
    if options.json:
        print_json({"ok": True, "out": str(options.out)})
    else:
        say(f"{'card':11} {options.out}")
    return DONE


def _render(options: RenderOptions) -> int:
    """Draw the missing episodes; return the exit code."""
    from executor.campaign.engine import claimed
    from executor.data.rerender import plan_rerender, rerender
    from executor.data.store import EpisodeStore
    from executor.data.views import check_drawable

    wanted = _wanted(options)
    source, out = EpisodeStore.open(options.store), EpisodeStore(options.out)
    if options.out.resolve() == options.store.resolve():
        raise BadOption("--out", options.out, "another folder than the store that is drawn")
    check_drawable()
    planned = plan_rerender(source, out, wanted)
    broken: list[str] = []
    drawn, interrupted = 0, False
    jobs = [(unit, str(episode.meta["version"])) for episode, unit in planned]
    with claimed(out, jobs) as todo, counting("drawing episodes", quiet=options.json) as progress:
        missing = frozenset(todo)
        left = [pair for pair, job in zip(planned, jobs, strict=True) if job in missing]

        def show_unit(unit: DemoUnit, result: Mapping[str, Any]) -> None:
            nonlocal drawn
            if result["ended"] == "drawn":
                drawn += 1
                progress(drawn, len(left))
                return
            broken.append(unit.name)
            if not options.json:
                tell(f"  {unit.name:24} {result['message']}", style="red")

        try:
            rerender(out, left, options.workers, show_unit, limit_s=options.limit_s)
        except KeyboardInterrupt:
            interrupted = True
    code = INTERRUPTED if interrupted else FAILED if broken else DONE
    if options.json:
        print_json({"ok": code == DONE, "exit_code": code, "store": str(out.path), "drawn": drawn, "broken": broken})
        return code
    words = f", {len(broken)} not: the same command tries them again" if broken else ""
    say(f"{'drawn now':11} {pluralize(drawn, 'episode')}{words}", style="bold")
    say(f"{'store':11} {out.path}")
    if interrupted:
        tell("scene2demo: interrupted; finished episodes are kept, the same command goes on", style="yellow")
    return code


def _wanted(options: RenderOptions) -> RerenderSettings:
    from executor.cli.commands.generate import channels_of
    from executor.cli.execution import check_unit_limit, check_workers
    from executor.data.rerender import RerenderSettings
    from executor.scenes.vary import LARGEST_SEED
    from executor.sim.render.frames import check_size

    check_workers(options.workers)
    check_unit_limit(options.limit_s)
    check(len(options.views) > 0, "--views", "nothing", "one of global, head, wrist, or several")
    check(len(set(options.views)) == len(options.views), "--views", " ".join(options.views), "each view once")
    check(0 <= options.seed <= LARGEST_SEED, "--seed", options.seed, f"a number from 0 to {LARGEST_SEED}")
    return RerenderSettings(
        views=options.views,
        size=check_size(options.size),
        **channels_of(options.channels),
        home=not options.plain,
        vary=options.vary,
        look=options.seed,
    )
