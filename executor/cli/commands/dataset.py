"""`scene2demo dataset export|info|check|merge|card`: work with a filled store."""

from __future__ import annotations

from pathlib import Path

from bddl.terminal import pluralize
from executor.cli.data_options import (
    CardOptions,
    CheckStoreOptions,
    ExportOptions,
    InfoOptions,
    MergeOptions,
)
from executor.cli.errors import DONE, FAILED, BadOption, check
from executor.cli.output import counting, print_json, print_text, say, tell
from executor.data.card import Contents, card, contents_of, page, shares
from executor.data.formats.export import write_set
from executor.data.formats.selection import Selection
from executor.data.formats.store_reader import stream_of
from executor.data.formats.table import EpisodeStream, repeats_text
from executor.data.store import EpisodeStore
from executor.data.upkeep import find_flaws, merge
from executor.system.files import write_text
from oag import clopper_pearson

Options = ExportOptions | InfoOptions | CheckStoreOptions | MergeOptions | CardOptions


def execute(options: Options) -> int:
    """Run the requested sub-command on a store; return the exit code.

    Raises:
        NotADataset: A folder is no store, or an episode in it cannot be read.
        NothingToExport, ExportExists, BadOption: The request cannot be met.
    """
    match options:
        case ExportOptions():
            _check_apart(options.out, options.store)
            only = Selection.parse(options.only)
            return _write(stream_of(EpisodeStore.open(options.store), options.include, only), options)
        case InfoOptions():
            return _info(options)
        case CheckStoreOptions():
            return _check(options)
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
    found = contents_of(EpisodeStore.open(options.store))
    if options.json:
        print_json({"ok": True, "store": str(options.store), **found.to_json()})
        return DONE
    say(f"{'episodes':11} {found.made} made of {found.asked} asked for, {found.kept} to export", style="bold")
    if found.repeats:
        say(f"{'repeated':11} {pluralize(found.repeats, 'demonstration')} more, as `dataset check` lists them")
    say(f"{'yield':11} {_share(found)}")
    for label, part in sorted(found.parts.items()):
        long = f", {part.simulated_s / part.kept:.1f} s each" if part.kept else ""
        say(f"{label:11} {part.succeeded} of {part.made} succeeded{long}")
    for kind, count in found.failures.most_common():
        say(f"{'failed':11} {count} x {kind}")
    say(f"{'samples':11} {found.samples} at {', '.join(f'{rate:g}' for rate in sorted(found.rates_hz)) or '-'} Hz")
    say(f"{'views':11} {shares(found.views, found.kept)}")
    each = f", {found.store_bytes / max(found.kept, 1) / 1000:.0f} kB a demonstration" if found.kept else ""
    say(f"{'size':11} {found.store_bytes / 1e6:.1f} MB{each}")
    return DONE


def _share(found: Contents) -> str:
    if not found.made:
        return "nothing made yet"
    low, high = clopper_pearson(found.succeeded, found.made)
    return f"{found.succeeded} of {found.made} succeeded ({100 * low:.1f} to {100 * high:.1f} %)"


def _check(options: CheckStoreOptions) -> int:
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


def _merge(options: MergeOptions) -> int:
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
