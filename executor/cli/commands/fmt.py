"""`scene2demo bddl fmt`: BDDL files laid out in one way."""

from __future__ import annotations

import shutil
from pathlib import Path

from bddl import check, lay_out
from bddl.printer import comments
from bddl.syntax.profiles import find_profile
from executor.cli.options.bad_option import BadOption
from executor.cli.options.bddl import Fmt
from executor.cli.terminal.errors import BAD_INPUT, DONE, FAILED
from executor.cli.terminal.output import print_json, say, tell
from executor.cli.work.bddl_files import NamedText, Unreadable, check_profile, find_files, profile_of, read_text
from executor.machine.files import temporary_beside


def execute(options: Fmt) -> int:
    """Prints, compares or writes the layout of some files.

    A file with mistakes is left as it is: what its author meant has to be settled first.

    Returns:
        2 when a file cannot be read, else 1 when a file has mistakes or, with `--check`, another layout; else 0.

    Raises:
        BadOption: A file does not exist, there is no such profile, `--check` and `--write` are both given, or what is
            to be written is no file.
    """
    check_profile(options.profile)
    if options.check and options.write:
        raise BadOption("--check", "goes with --write", "one of them")
    outcomes: dict[str, str] = {}
    for name in find_files(options.files):
        source = read_text(name)
        if isinstance(source, Unreadable):
            outcomes[source.name] = "unreadable"
            if not options.json:
                tell(f"scene2demo: {source}", style="red")
            continue
        laid_out = _laid_out(source, profile_of(source.text, options.profile), quiet=options.json)
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


def _laid_out(source: NamedText, profile: str, *, quiet: bool) -> str | None:
    """Returns the new text of a file, or None when it has mistakes, the first of which is printed."""
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


def _deliver(source: NamedText, laid_out: str, options: Fmt) -> None:
    if options.check or (options.json and not options.write):
        return
    if source.path is None or not options.write:
        say(laid_out.rstrip("\n"))
    elif laid_out != source.text:
        _replace(source.path, laid_out)


def _replace(path: Path, text: str) -> None:
    """Writes a file, all of it or nothing; a link stays a link, and the permissions stay."""
    if not path.is_file():
        raise BadOption("--write", f"{path} is no file", "files, and no pipes or devices")
    target = path.resolve()
    with temporary_beside(target) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")
        shutil.copymode(target, temporary)
