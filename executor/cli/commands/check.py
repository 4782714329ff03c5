"""`scene2demo bddl check`: what is wrong in BDDL files, and what is suspicious."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from bddl import Diagnostic, analyse
from bddl.visible import counted
from executor.cli.options.bddl import Check
from executor.cli.terminal.counting import counting
from executor.cli.terminal.errors import BAD_INPUT, DONE, FAILED
from executor.cli.terminal.output import ERR, print_json, say, tell
from executor.cli.work.bddl_files import Unreadable, check_profile, find_files, profile_of, read_text

# Fewer files than this are checked before anyone could read how far it is.
_MANY = 20
_STYLES = {"error": "red", "warning": "yellow", "note": "cyan"}


@dataclass(frozen=True, slots=True)
class Checked:
    """What was found in one file."""

    name: str
    profile: str
    found: tuple[Diagnostic, ...]

    @property
    def wrong(self) -> bool:
        """True when it has a mistake."""
        return any(diagnostic.severity == "error" for diagnostic in self.found)


def execute(options: Check) -> int:
    """Prints what is wrong or suspicious in some files.

    Returns:
        2 when a file cannot be read, else 1 when something is wrong, else 0.

    Raises:
        BadOption: A file does not exist, or there is no such profile.
    """
    check_profile(options.profile)
    names = find_files(options.files)
    results: list[Checked] = []
    unreadable: list[Unreadable] = []
    quiet = options.json or len(names) < _MANY or not ERR.is_terminal
    with counting("checking", quiet=quiet) as progress:
        for done, name in enumerate(names):
            progress(done, len(names))
            source = read_text(name)
            if isinstance(source, Unreadable):
                unreadable.append(source)
                continue
            profile = profile_of(source.text, options.profile)
            results.append(Checked(source.name, profile, analyse(source.text, profile)))
            if not options.json:
                _print(results[-1])
    counts: Counter[str] = Counter(diagnostic.severity for result in results for diagnostic in result.found)
    failed = counts["error"] > 0 or (options.strict and counts["warning"] > 0)
    if options.json:
        print_json(_as_json(results, unreadable, counts, ok=not failed and not unreadable))
    else:
        for found in unreadable:
            tell(f"scene2demo: {found}", style="red")
        if results:
            tell(_summary(results, counts), style="red" if failed else None)
    return BAD_INPUT if unreadable else FAILED if failed else DONE


def _print(result: Checked) -> None:
    for diagnostic in result.found:
        place = f"{result.name}:{diagnostic.line}:{diagnostic.column}"
        style = _STYLES[diagnostic.severity]
        say(f"{place}: {diagnostic.severity}: {diagnostic.message} [{diagnostic.code}]", style=style)
        for line in diagnostic.excerpt.split("\n"):
            say(f"  {line}")
        if diagnostic.hint:
            say(f"  hint: {diagnostic.hint}")
        say(f"  see {diagnostic.page}\n")


def _summary(results: list[Checked], counts: Counter[str]) -> str:
    files = counted(len(results), "file")
    if not counts:
        return f"{files} checked, nothing found"
    kinds = ", ".join(counted(counts[kind], kind) for kind in _STYLES if counts[kind])
    where = f" in {sum(bool(result.found) for result in results)} of them" if len(results) > 1 else ""
    return f"{files} checked: {kinds}{where}"


def _as_json(
    results: list[Checked], unreadable: list[Unreadable], counts: Counter[str], *, ok: bool
) -> dict[str, object]:
    return {
        "ok": ok,
        "errors": counts["error"],
        "warnings": counts["warning"],
        "files": [
            {
                "file": result.name,
                "profile": result.profile,
                "ok": not result.wrong,
                "diagnostics": [diagnostic.to_json() for diagnostic in result.found],
            }
            for result in results
        ],
        "unreadable": [{"file": found.name, "why": found.why} for found in unreadable],
    }
