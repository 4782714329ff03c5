"""The console script: parse the options, run one sub-command, turn every exception into a message and an exit code.

Command files import libraries only inside their functions, so that `--help`, a mistyped word and a missing input file
are answered at once.
"""

from __future__ import annotations

import errno
import os
import pkgutil
import re
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr, suppress
from dataclasses import fields, is_dataclass
from functools import cache, reduce
from importlib import import_module
from io import StringIO
from operator import or_
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, NamedTuple, TextIO, Union, get_args, get_origin, get_type_hints

import tyro

import executor
import executor.cli.commands
from executor.cli.options import Read

TWO_WORDS = {("assets", "import"), ("bench", "replay"), ("bench", "photo")}
"""Commands of two words whose first word is a command with positional arguments of its own; their files are called
`assets_import.py` and so on."""

_ORDER = (
    *(
        "run",
        "plan",
        "tasks",
        "stability",
        "rollout",
        "evolve",
        "bench",
        "generate",
        "dataset",
        "status",
        "replay",
        "train",
        "evaluate",
    ),
    "view",
    "conversation",
    *("bench replay", "bench photo", "verify", "graph", "recheck", "doctor", "scenes", "photo", "assets"),
    *("assets import", "bddl"),
)
"""Commands in the order of the help; others follow by name."""

_POSITIONAL = get_args(tyro.conf.Positional[str])[1]
_OF_ALL = ("--help",)
_OF_THE_PROGRAM = ("--help", "--version")


class CommandFiles(NamedTuple):
    """What the files in `commands/` give.

    Attributes:
        options: Name of a command, as typed -> its class `Options`.
        broken: Name of a command whose file cannot be loaded -> the message about it.
    """

    options: dict[str, type]
    broken: dict[str, str]


@cache
def load_commands() -> CommandFiles:
    """Load all files of commands; one that cannot be loaded is left out, so that the others work."""
    files = {_name_of(found.name): found.name for found in pkgutil.iter_modules(executor.cli.commands.__path__)}
    options: dict[str, type] = {}
    broken: dict[str, str] = {}
    for name in [name for name in _ORDER if name in files] + sorted(set(files) - set(_ORDER)):
        try:
            options[name] = import_module(f"executor.cli.commands.{files[name]}").Options
        except Exception as error:
            problem = f"cannot be loaded, so that `{name}` is left out: {type(error).__name__}: {error}"
            broken[name] = f"the command file {files[name]}.py {problem}"
    return CommandFiles(options, broken)


def commands() -> dict[str, type]:
    """Return the options of each command that can be loaded, by its name as typed."""
    return load_commands().options


def _name_of(file: str) -> str:
    """Return the name of a file's command: of two words for those of `TWO_WORDS`, else with `-` for `_`."""
    words = tuple(file.split("_"))
    return " ".join(words) if words in TWO_WORDS else "-".join(words)


def second_words(options: type) -> dict[str, type]:
    """Return the options of each second word of a command such as `dataset`; empty for other commands."""
    union = get_type_hints(options, include_extras=True).get("command")
    return {get_args(choice)[1].name: get_args(choice)[0] for choice in get_args(union)}


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
    """Return which typed command or option does not exist, with suggestions; else empty."""
    if not arguments:
        return ""
    first, *rest = arguments
    known = commands()
    if first not in known:
        if first.startswith("-"):
            return _no_such(f"scene2demo has no option {first} before a command", first, _OF_THE_PROGRAM)
        return _no_such(f"there is no command {first!r}", first, [name for name in known if " " not in name])
    command, options = first, known[first]
    if seconds := second_words(options):
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
    from bddl import near_names

    bare = {_bare(word): word for word in legal}
    name = _bare(typed)
    near = (name,) if name in bare else near_names(name, bare)
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
    """Run the command line, by default that of this process, and end the process with its exit code."""
    # A scheduler whose time is up asks like this: what is done is kept, as after Ctrl-C.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        code = run(list(sys.argv[1:] if arguments is None else arguments))
        sys.stdout.flush()
    except (OSError, KeyboardInterrupt) as end:
        # The reader of the help is gone, the disk is full, or Ctrl-C came while the first libraries loaded.
        from executor.cli.errors import explain

        ending = explain(end)
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
        from executor.system.extras import installed_version

        print(f"scene2demo {installed_version('scene2demo') or '(not installed)'}")
        return 0
    if tuple(arguments[:2]) in TWO_WORDS:
        arguments = [" ".join(arguments[:2]), *arguments[2:]]
    elif arguments and tuple(arguments[0].split("-")) in TWO_WORDS:
        arguments = [arguments[0].replace("-", " "), *arguments[1:]]
    broken = load_commands().broken
    if arguments and arguments[0] in broken:
        return _refuse(broken[arguments[0]], "ImportError", as_json=as_json)
    for problem in broken.values():
        sys.stderr.write(f"scene2demo: {_legible(problem)}\n")
    try:
        with redirect_stderr(StringIO()):
            chosen = _parse(arguments)
    except SystemExit as end:
        if not end.code:
            return 0
        if problem := find_mistake(arguments):
            return _refuse(problem, "usage", as_json=as_json)
        _print_parser_message(arguments)
        if as_json:
            _refuse("the command line is not right; see scene2demo --help", "usage", as_json=True)
        return 2
    options = getattr(chosen, "command", chosen)
    # What a command needs takes seconds to load, and a path that is mistyped is known at once.
    if problem := find_missing_input(options):
        return _refuse(problem, "FileNotFoundError", as_json=options.json)
    try:
        return int(import_module(type(chosen).__module__).execute(options))
    except BaseException as error:
        if isinstance(error, SystemExit | GeneratorExit):
            raise
        return _end(error, options)


def _refuse(problem: str, kind: str, *, as_json: bool) -> int:
    """Print a usage error with control characters escaped; return the exit code."""
    if as_json:
        from executor.cli.output import print_json

        print_json(_error_json(2, kind, problem))
    else:
        sys.stderr.write(f"scene2demo: {_legible(problem)}\n")
    return 2


def _legible(text: str) -> str:
    if text.isprintable():
        return text
    from bddl.terminal import escape_control

    return escape_control(text)


def _print_parser_message(arguments: list[str]) -> None:
    """Print the parser's message about a command line, with control characters escaped."""
    with suppress(SystemExit):
        _parse([_legible(argument) for argument in arguments])


def _parse(arguments: list[str]) -> Any:
    """Return the chosen command's options.

    Raises:
        SystemExit: The command line is not right, or help was requested.
    """
    union: Any = reduce(or_, (Annotated[one, tyro.conf.subcommand(name)] for name, one in commands().items()))
    return tyro.cli(
        union,
        prog="scene2demo",
        description=_DESCRIPTION,
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes, tyro.conf.DisallowNone),
    )


def _end(error: BaseException, options: Any) -> int:
    """Print the message of an exception and return the exit code; re-raise an internal error with `--debug`."""
    from executor.cli.errors import explain
    from executor.cli.output import print_json, tell

    ending = explain(error)
    if options.debug and not ending.expected:
        raise error
    if ending.kind == "unread":
        pass  # The reader of the output is gone.
    elif options.json:
        usage = getattr(error, "usage", None)
        used = {} if usage is None else {"usage": usage}
        print_json({**_error_json(ending.code, ending.kind, ending.message), **used})
    else:
        tell(f"scene2demo: {ending.message}", style="red" if ending.code else None)
    return ending.code


def _error_json(code: int, kind: str, message: str) -> dict[str, object]:
    return {"ok": False, "exit_code": code, "error": {"kind": kind, "message": message}}


if __name__ == "__main__":
    main()
