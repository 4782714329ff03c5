"""The console script: parse the options, run one sub-command, turn every exception into a message and an exit code.

A sub-command's module is imported when it is chosen, so that `--help` answers at once. Unknown words and missing input
files are reported before anything is loaded.
"""

from __future__ import annotations

import errno
import importlib
import os
import pkgutil
import re
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, redirect_stderr, suppress
from dataclasses import fields, is_dataclass
from functools import cache
from importlib import import_module
from io import StringIO
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, TextIO, Union, cast, get_args, get_origin, get_type_hints

import tyro

import executor
import executor.cli.commands
from executor.cli.command_options import BddlOptions, BddlSubCommand, SubCommand
from executor.cli.data_options import DatasetOptions, DatasetSubCommand
from executor.cli.options import Read

TWO_WORDS = {("assets", "import"), ("bench", "replay"), ("bench", "photo")}
"""Commands of two words whose first word is a command with positional arguments of its own."""

_POSITIONAL = get_args(tyro.conf.Positional[str])[1]
_OF_ALL = ("--help",)
_OF_THE_PROGRAM = ("--help", "--version")
_BELOW: Mapping[type, object] = {BddlOptions: BddlSubCommand, DatasetOptions: DatasetSubCommand}
# Commands whose file has another name.
_FILES = {
    "check": "bddl",
    "fmt": "bddl",
    "benchreplay": "bench",
    **dict.fromkeys(("export", "info", "checkstore", "merge", "card"), "dataset"),
    "benchphoto": "bench_photo",
    "runphoto": "run_photo",
    "scenes": "catalog",
    "assets": "catalog",
    "import": "catalog",
}


def commands(union: object = None) -> dict[str, type]:
    """Return the options of each sub-command, by its name; by default of all commands."""
    return {get_args(choice)[1].name: get_args(choice)[0] for choice in get_args(union or all_commands())}


@cache
def all_commands() -> Any:
    """Return the union of all commands' options: those of `SubCommand`, then those that stand in their command's file.

    The latter are files of `executor.cli.commands` with a class `Options`; `_` in a file's name becomes `-`.
    """
    unions = (SubCommand, *_BELOW.values())
    served = {*_FILES.values(), *(_short_name(options) for one in unions for options in commands(one).values())}
    union: Any = SubCommand
    for found in pkgutil.iter_modules(executor.cli.commands.__path__):
        if found.name not in served:
            options = import_module(f"executor.cli.commands.{found.name}").Options
            union |= Annotated[options, tyro.conf.subcommand(found.name.replace("_", "-"))]
    return union


def _short_name(options: type) -> str:
    return options.__name__.removesuffix("Options").lower()


def option_names(options: type) -> tuple[str, ...]:
    """Return the options of a sub-command, as they are typed; positional arguments are left out."""
    return (*_own_names(options), *_OF_ALL)


def _own_names(options: type) -> Iterator[str]:
    hints = get_type_hints(options, include_extras=True)
    for field in fields(options):
        hint = hints[field.name]
        if is_dataclass(hint):
            yield from _own_names(hint)  # type: ignore[arg-type]
        elif _POSITIONAL not in _metadata(hint):
            name = field.name.replace("_", "-")
            yield f"--no-{name}" if field.default is True else f"--{name}"


def find_mistake(arguments: Sequence[str]) -> str:
    """Return which command or option does not exist, with suggestions; else empty.

    Args:
        arguments: What was typed after the program's name, and is not right.
    """
    if not arguments:
        return ""
    first, *rest = arguments
    known = commands()
    if first not in known:
        if first.startswith("-"):
            return _no_such(f"scene2demo has no option {first} before a command", first, _OF_THE_PROGRAM)
        spoken = [name for name in known if tuple(name.split("-")) not in TWO_WORDS]
        return _no_such(f"there is no command {first!r}", first, spoken)
    command, options = " ".join(first.split("-")) if tuple(first.split("-")) in TWO_WORDS else first, known[first]
    if options in _BELOW:
        seconds = commands(_BELOW[options])
        if not rest or rest[0].startswith("-"):
            return ""  # The parser lists them.
        command, second = f"{command} {rest[0]}", rest.pop(0)
        if second not in seconds:
            return _no_such(f"there is no command {command!r}", second, list(seconds))
        options = seconds[second]
    legal = option_names(options)
    for typed in rest:
        name = typed.partition("=")[0].replace("_", "-")
        if re.match(r"--?[^\W\d]", name) and name not in (*legal, "-h"):
            return _no_such(f"{command} has no option {name}", name, legal)
    if rest and (near := _near(rest[0], [second for head, second in TWO_WORDS if head == command])):
        return f"{command} takes no {rest[0]!r}; did you mean {command} {near[0]}?"
    return ""


def _no_such(problem: str, typed: str, legal: Sequence[str]) -> str:
    near = _near(typed, legal)
    return f"{problem}; " + (f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(legal)}")


def _near(typed: str, legal: Sequence[str]) -> list[str]:
    """Return the legal words with a similar spelling or a common beginning; the likeliest first."""
    bare = {_bare(word): word for word in legal}
    name = _bare(typed)
    near = (name,) if name in bare else import_module("bddl").near_names(name, bare)
    begun = [word for word in bare if len(name) > 1 and (word.startswith(name) or name.startswith(word))]
    return [bare[word] for word in near or begun]


def _bare(word: str) -> str:
    return word.lstrip("-").removeprefix("no-")


def find_missing_input(options: object) -> str:
    """Return the error for the first input file that does not exist, as its reader would word it; else empty."""
    hints = get_type_hints(type(options), include_extras=True)
    for field in fields(options):  # type: ignore[arg-type]
        read = next((found for found in _metadata(hints[field.name]) if isinstance(found, Read)), None)
        value = getattr(options, field.name)
        if read is None or value is None:
            continue
        for path in map(Path, value if isinstance(value, tuple) else (value,)):
            is_name = read.named and path.suffix != ".json" and len(path.parts) < 2
            if not is_name and _is_absent(path):
                why = os.strerror(errno.ENOENT)
                return f"{read.what} {path}: cannot be read: {why}" if read.what else f"{path}: {why}"
    return ""


def _is_absent(path: Path) -> bool:
    try:
        path.stat()
    except FileNotFoundError:
        return True
    except OSError:
        return False  # Its reader reports the problem.
    return False


def _metadata(hint: Any) -> tuple[Any, ...]:
    """Return the metadata of an annotated type, and of the types of a union."""
    if get_origin(hint) is Annotated:
        return (*_metadata(get_args(hint)[0]), *get_args(hint)[1:])
    parts = get_args(hint) if get_origin(hint) in (Union, UnionType) else ()
    return tuple(found for part in parts for found in _metadata(part))


_DESCRIPTION = (
    "From a scene and a sentence to robot demonstrations whose plans are proved before anything moves.\n\n"
    "Exit codes: 0 done; 1 the work ran and failed; 2 misuse or bad input; 3 the disk is full; 130 after Ctrl-C.\n"
    "`scene2demo --version` prints the version."
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and end the process with its exit code.

    Args:
        arguments: What was typed after the program's name; by default that of this process.
    """
    # A scheduler whose time is up asks like this: what is done is kept, as after Ctrl-C.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        code = run(list(sys.argv[1:] if arguments is None else arguments))
        sys.stdout.flush()
    except (OSError, KeyboardInterrupt) as end:
        # The reader of the help is gone, the disk is full, or Ctrl-C came while the first libraries loaded.
        ending = importlib.import_module("executor.cli.errors").explain(end)
        if ending.message:
            sys.stderr.write(f"scene2demo: {ending.message}\n")
        code = ending.code
    if not _flush(sys.stdout):
        # Else the interpreter tries once more when it ends, and complains.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(code)


def _flush(stream: TextIO) -> bool:
    """Flush a stream, and return whether that worked."""
    try:
        stream.flush()
    except OSError:
        return False
    return True


def run(arguments: list[str]) -> int:
    """Run a command line and return its exit code."""
    as_json = "--json" in arguments
    try:
        executor.require_own_packages()
    except ImportError as foreign:
        return _refuse(str(foreign), "ImportError", as_json=False)
    if arguments == ["--version"]:
        extras = importlib.import_module("executor.system.extras")
        print(f"scene2demo {extras.installed_version('scene2demo') or '(not installed)'}")
        return 0
    if tuple(arguments[:2]) in TWO_WORDS:
        arguments = ["-".join(arguments[:2]), *arguments[2:]]
    try:
        chosen = _parse_quietly(arguments)
    except SystemExit as end:
        if not end.code:
            return 0
        if problem := find_mistake(arguments):
            return _refuse(problem, "usage", as_json=as_json)
        _print_parser_message(arguments)
        if as_json:
            _refuse("the command line is not right; see scene2demo --help", "usage", as_json=True)
        return 2
    options: Any = chosen.command if isinstance(chosen, BddlOptions | DatasetOptions) else chosen
    # What a command needs takes seconds to load, and a path that is mistyped is known at once.
    if problem := find_missing_input(options):
        return _refuse(problem, "FileNotFoundError", as_json=options.json)
    try:
        # Imports take a second or two, and Ctrl-C in them is an interruption like any other.
        name = _short_name(type(options))
        name += "photo" if getattr(options, "photo", None) is not None else ""
        own = type(options).__module__ if not name else f"executor.cli.commands.{_FILES.get(name, name)}"
        with _show_begin(options.begins, quiet=options.json):
            module = importlib.import_module(own)
        return int(module.execute(options))
    except BaseException as error:
        if isinstance(error, SystemExit | GeneratorExit):
            raise
        return _end(error, options)


def _show_begin(what: str, *, quiet: bool) -> AbstractContextManager[object]:
    """Show a message while slow imports run, unless quiet."""
    if quiet or not what:
        return nullcontext()
    return cast("AbstractContextManager[object]", importlib.import_module("executor.cli.output").counting(what))


def _refuse(problem: str, kind: str, *, as_json: bool) -> int:
    """Print a usage error with control characters escaped; return the exit code."""
    if as_json:
        importlib.import_module("executor.cli.output").print_json(_error_json(2, kind, problem))
    else:
        if not problem.isprintable():
            problem = importlib.import_module("bddl.terminal").escape_control(problem)
        sys.stderr.write(f"scene2demo: {problem}\n")
    return 2


def _parse_quietly(arguments: list[str]) -> SubCommand:
    """Parse a command line; errors are not printed.

    Raises:
        SystemExit: The command line is not right, or help was requested.
    """
    with redirect_stderr(StringIO()):
        return _parse(arguments)


def _print_parser_message(arguments: list[str]) -> None:
    """Print the parser's message about a command line, with control characters escaped."""
    if not all(argument.isprintable() for argument in arguments):
        legible = importlib.import_module("bddl.terminal").escape_control
        arguments = [legible(argument) for argument in arguments]
    with suppress(SystemExit):
        _parse(arguments)


def _parse(arguments: list[str]) -> SubCommand:
    chosen: SubCommand = tyro.cli(
        all_commands(),
        prog="scene2demo",
        description=_DESCRIPTION,
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes, tyro.conf.DisallowNone),
    )
    return chosen


def _end(error: BaseException, options: Any) -> int:
    """Print the message of an exception and return the exit code; re-raise an internal error with `--debug`."""
    errors = importlib.import_module("executor.cli.errors")
    output = importlib.import_module("executor.cli.output")
    ending = errors.explain(error)
    if options.debug and not ending.expected:
        raise error
    if ending.kind == "unread":
        pass  # The reader of the output is gone.
    elif options.json:
        usage = getattr(error, "usage", None)
        used = {} if usage is None else {"usage": usage}
        output.print_json({**_error_json(ending.code, ending.kind, ending.message), **used})
    else:
        output.tell(f"scene2demo: {ending.message}", style="red" if ending.code else None)
    return int(ending.code)


def _error_json(code: int, kind: str, message: str) -> dict[str, object]:
    return {"ok": False, "exit_code": code, "error": {"kind": kind, "message": message}}


if __name__ == "__main__":
    main()
