"""`scene2demo bddl check|fmt`: report errors and warnings of BDDL files, or lay the files out."""

from __future__ import annotations

import shutil
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from bddl.files import atomic_path, read_bounded, read_stream
from bddl.terminal import pluralize
from executor.cli.errors import BAD_INPUT, DONE, FAILED, BadOption
from executor.cli.options import BddlFiles, CommonOptions, Flag, Profile
from executor.cli.output import ERR, counting, print_json, say, tell

if TYPE_CHECKING:
    from bddl import Diagnostic


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
    """Lay out BDDL files; every word and every comment stays.

    The exit code is 0 when all is well, 1 when a file has mistakes or, with --check, another layout.
    """

    files: BddlFiles
    profile: Profile = None
    check: Flag = False
    """Change nothing; name the files that would change."""
    write: Flag = False
    """Write the files instead of printing them."""


SubCommand = Annotated[CheckOptions, tyro.conf.subcommand("check")] | Annotated[FmtOptions, tyro.conf.subcommand("fmt")]


@dataclass(frozen=True)
class Options:
    """Examine BDDL files, or lay them out."""

    command: SubCommand


# Fewer files than this are checked before anyone could read how far it is.
_MANY = 20
_STYLES = {"error": "red", "warning": "yellow", "note": "cyan"}
_STANDARD_INPUT = "-"
_EXPECTED = "a BDDL file, a folder with such files, or - for the standard input"


def execute(options: SubCommand) -> int:
    """Check files, or lay them out.

    Returns:
        2 when a file cannot be read, else 1 when a file has mistakes (or warnings with `--strict`, or another layout
        with `fmt --check`), else 0.
    """
    from bddl import PROFILES

    if options.profile is not None and options.profile not in PROFILES:
        raise BadOption("--profile", options.profile, f"one of {', '.join(PROFILES)}")
    return _check(options) if isinstance(options, CheckOptions) else _lay_out(options)


@dataclass(frozen=True, slots=True)
class _BddlText:
    """A text, or why there is none.

    Attributes:
        name: The file's path as it was given, or `<stdin>`.
        path: The file, or None for the standard input.
        text: What it holds; empty where it cannot be read.
        unreadable: What keeps it from being read, as the rest of a sentence that begins with the name; else empty.
    """

    name: str
    path: Path | None
    text: str = ""
    unreadable: str = ""


def _check(options: CheckOptions) -> int:
    """Print the diagnostics of some files."""
    from bddl import analyse
    from bddl.dialects import detect_dialect

    names = _find_files(options.files)
    results: list[dict[str, object]] = []
    unreadable: list[_BddlText] = []
    counts: Counter[str] = Counter()
    suspicious = 0
    with counting("checking", quiet=options.json or len(names) < _MANY or not ERR.is_terminal) as progress:
        for done, source in enumerate(map(_read_text, names)):
            progress(done, len(names))
            if source.unreadable:
                unreadable.append(source)
                continue
            profile = options.profile or detect_dialect(source.text)
            found = analyse(source.text, profile)
            counts.update(diagnostic.severity for diagnostic in found)
            suspicious += bool(found)
            ok = all(diagnostic.severity != "error" for diagnostic in found)
            listed = [diagnostic.to_json() for diagnostic in found]
            results.append({"file": source.name, "profile": profile, "ok": ok, "diagnostics": listed})
            if not options.json:
                _print_found(source.name, found)
    failed = counts["error"] > 0 or (options.strict and counts["warning"] > 0)
    if options.json:
        numbers = {"ok": not failed and not unreadable, "errors": counts["error"], "warnings": counts["warning"]}
        missing = [{"file": source.name, "why": source.unreadable} for source in unreadable]
        print_json({**numbers, "files": results, "unreadable": missing})
    else:
        for source in unreadable:
            tell(f"scene2demo: {source.name} {source.unreadable}", style="red")
        if results:
            kinds = ", ".join(pluralize(counts[kind], kind) for kind in _STYLES if counts[kind]) or "nothing found"
            where = f" in {suspicious} of them" if suspicious and len(results) > 1 else ""
            separator = ":" if suspicious else ","
            tell(
                f"{pluralize(len(results), 'file')} checked{separator} {kinds}{where}", style="red" if failed else None
            )
    return BAD_INPUT if unreadable else FAILED if failed else DONE


def _print_found(name: str, found: Sequence[Diagnostic]) -> None:
    for diagnostic in found:
        place = f"{name}:{diagnostic.line}:{diagnostic.column}"
        style = _STYLES[diagnostic.severity]
        say(f"{place}: {diagnostic.severity}: {diagnostic.message} [{diagnostic.code}]", style=style)
        for line in diagnostic.excerpt.split("\n"):
            say(f"  {line}")
        if diagnostic.hint:
            say(f"  hint: {diagnostic.hint}")
        say(f"  see {diagnostic.page}\n")


def _lay_out(options: FmtOptions) -> int:
    """Print, compare or write the layout of some files.

    A file with errors is left as it is: its meaning has to be settled first.
    """
    from bddl.dialects import detect_dialect

    if options.check and options.write:
        raise BadOption("--check", "goes with --write", "one of them")
    outcomes: dict[str, str] = {}
    for name in _find_files(options.files):
        source = _read_text(name)
        if source.unreadable:
            outcomes[source.name] = "unreadable"
            if not options.json:
                tell(f"scene2demo: {source.name} {source.unreadable}", style="red")
            continue
        laid_out = _laid_out(source, options.profile or detect_dialect(source.text), quiet=options.json)
        if laid_out is None:
            outcomes[source.name] = "mistakes"
        elif laid_out == source.text:
            outcomes[source.name] = "unchanged"
        else:
            outcomes[source.name] = "changed" if options.write else "would change"
        if laid_out is not None:
            _deliver(source, laid_out, options)
    unreadable = "unreadable" in outcomes.values()
    failed = unreadable or "mistakes" in outcomes.values() or (options.check and "would change" in outcomes.values())
    if options.json:
        print_json({"ok": not failed, "files": [{"file": name, "outcome": did} for name, did in outcomes.items()]})
    elif options.check or options.write:
        for name, did in outcomes.items():
            if did not in ("unchanged", "unreadable"):
                tell(f"{did}: {name}")
    return BAD_INPUT if unreadable else FAILED if failed else DONE


def _laid_out(source: _BddlText, profile: str, *, quiet: bool) -> str | None:
    """Return the new text of a file, or None when it has errors, the first of which is printed."""
    from bddl import check, lay_out
    from bddl.dialects import find_profile
    from bddl.printer import comments

    wrong = [found for found in check(source.text, profile) if found.severity == "error"]
    if wrong:
        if not quiet:
            first = wrong[0]
            more = f" (and {len(wrong) - 1} more; see scene2demo bddl check)" if len(wrong) > 1 else ""
            tell(f"{source.name}:{first.line}:{first.column}: {first.message} [{first.code}]{more}", style="red")
        return None
    line_end = "\r\n" if "\r\n" in source.text else "\n"
    text = source.text.replace("\r\n", "\n")
    free_text = find_profile(profile).free_text
    laid_out = lay_out(text, free_text)
    if comments(laid_out, free_text) != comments(text, free_text) or check(laid_out, profile):
        raise RuntimeError(f"laying out {source.name} would change what it says; the file is left as it is")
    return laid_out.replace("\n", line_end)


def _deliver(source: _BddlText, laid_out: str, options: FmtOptions) -> None:
    if options.check or (options.json and not options.write):
        return
    if source.path is None or not options.write:
        say(laid_out.rstrip("\n"))
    elif laid_out != source.text:
        _replace(source.path, laid_out)


def _replace(path: Path, text: str) -> None:
    """Write a file atomically; a link stays a link, and the permissions stay."""
    if not path.is_file():
        raise BadOption("--write", f"{path} is no file", "files, and no pipes or devices")
    target = path.resolve()
    with atomic_path(target) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")
        shutil.copymode(target, temporary)


def _find_files(names: Sequence[str]) -> tuple[str, ...]:
    """Return the named files, those in named folders included, each once."""
    found: list[str] = []
    for name in names:
        path = Path(name)
        if path.is_dir() and name != _STANDARD_INPUT:
            inside = sorted(str(file) for file in path.rglob("*.bddl") if file.is_file())
            if not inside:
                raise BadOption(name, "has no file that ends in .bddl", "a BDDL file or a folder with such files")
            found += inside
        # What exists and is no folder can be read, be it a file, a pipe or a device.
        elif name == _STANDARD_INPUT or path.exists():
            found.append(name)
        else:
            raise BadOption(name, "does not exist", _EXPECTED)
    if not found:
        raise BadOption("FILE", "is missing", _EXPECTED)
    return tuple(dict.fromkeys(found))


def _read_text(name: str) -> _BddlText:
    """Return the text of a file or of the standard input, or why there is none: the other files can still be read."""
    path = None if name == _STANDARD_INPUT else Path(name)
    shown = "<stdin>" if path is None else name
    try:
        content = read_stream(sys.stdin.buffer, shown) if path is None else read_bounded(path, pipes=True)
        return _BddlText(shown, path, content.decode("utf-8"))
    except UnicodeDecodeError as error:
        return _BddlText(shown, path, unreadable=f"is not UTF-8 text (byte {error.start}); save it in UTF-8")
    except OSError as error:
        return _BddlText(shown, path, unreadable=f"cannot be read: {error.strerror or error}")
