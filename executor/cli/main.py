"""The console script: reads the options, runs one sub-command, turns every exception into a sentence and an exit code.

A sub-command's module is imported when it is chosen, so that `--help` answers at once.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext, redirect_stderr, suppress
from io import StringIO
from typing import Any, TextIO, cast

import tyro

import executor
from executor.cli.usage import TWO_WORDS, missing_input, mistake
from executor.cli.words.datasets import DatasetOptions
from executor.cli.words.running import BddlOptions, SubCommand

# Which file has a command that is not named like it.
_FILES = {
    "check": "bddl",
    "fmt": "bddl",
    "benchreplay": "bench",
    "replay": "datasets.replay",
    "generate": "datasets.generate",
    "render": "datasets.render",
    "train": "policies.train",
    "evaluate": "policies.evaluate",
    "correct": "policies.correct",
    **dict.fromkeys(("export", "convert", "info", "checkstore", "merge", "card"), "datasets.dataset"),
    "photo": "photo.photo",
    "benchphoto": "photo.bench",
    "runphoto": "photo.run",
    "scenes": "catalog",
    "assets": "catalog",
    "import": "catalog",
}
_DESCRIPTION = (
    "From a scene and a sentence to robot demonstrations whose plans are proved before anything moves.\n\n"
    "Exit codes: 0 done; 1 the work ran and failed; 2 misuse or bad input; 3 the disk is full; 130 after Ctrl-C.\n"
    "`scene2demo --version` prints the version."
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command line and ends the process with its exit code.

    Args:
        arguments: What was typed after the program's name; by default that of this process.
    """
    # A scheduler whose time is up asks like this: what is done is kept, as after Ctrl-C.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        code = run(list(sys.argv[1:] if arguments is None else arguments))
        sys.stdout.flush()
    except (OSError, KeyboardInterrupt) as end:
        # Nobody reads the help any more, the disk has no room for it, or Ctrl-C came while the first libraries loaded.
        ending = importlib.import_module("executor.cli.errors").explain(end)
        if ending.message:
            sys.stderr.write(f"scene2demo: {ending.message}\n")
        code = ending.code
    if not _goes_out(sys.stdout):
        # Else the interpreter tries once more when it ends, and complains.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(code)


def _goes_out(stream: TextIO) -> bool:
    """Writes what a stream still holds, and decides whether that went well."""
    try:
        stream.flush()
    except OSError:
        return False
    return True


def run(arguments: list[str]) -> int:
    """Returns the exit code of a command line."""
    as_json = "--json" in arguments
    try:
        executor.require_own_packages()
    except ImportError as foreign:
        return _refuse(str(foreign), "ImportError", as_json=False)
    if arguments == ["--version"]:
        extras = importlib.import_module("executor.machine.extras")
        print(f"scene2demo {extras.installed_version('scene2demo') or '(not installed)'}")
        return 0
    if tuple(arguments[:2]) in TWO_WORDS:
        arguments = ["-".join(arguments[:2]), *arguments[2:]]
    try:
        chosen = _parsed(arguments)
    except SystemExit as end:
        if not end.code:
            return 0
        if problem := mistake(arguments):
            return _refuse(problem, "usage", as_json=as_json)
        _say_what_the_parser_says(arguments)
        if as_json:
            _refuse("the command line is not right; see scene2demo --help", "usage", as_json=True)
        return 2
    options: Any = chosen.command if isinstance(chosen, BddlOptions | DatasetOptions) else chosen
    # What a command needs takes seconds to load, and a path that is mistyped is known at once.
    if problem := missing_input(options):
        return _refuse(problem, "FileNotFoundError", as_json=options.json)
    try:
        # Imports take a second or two, and Ctrl-C in them is an interruption like any other.
        name = type(options).__name__.removesuffix("Options").lower()
        name += "photo" if getattr(options, "photo", None) is not None else ""
        with _told(options.begins, quiet=options.json):
            module = importlib.import_module(f"executor.cli.commands.{_FILES.get(name, name)}")
        return int(module.execute(options))
    except BaseException as error:
        if isinstance(error, SystemExit | GeneratorExit):
            raise
        return _end(error, options)


def _told(what: str, *, quiet: bool) -> AbstractContextManager[object]:
    """Shows what takes time while it does, where there is anything to show."""
    if quiet or not what:
        return nullcontext()
    return cast("AbstractContextManager[object]", importlib.import_module("executor.cli.output").counting(what))


def _refuse(problem: str, kind: str, *, as_json: bool) -> int:
    """Says what is wrong with what was typed, without what would steer the terminal; returns the exit code."""
    if as_json:
        importlib.import_module("executor.cli.output").print_json(_error_json(2, kind, problem))
    else:
        if not problem.isprintable():
            problem = importlib.import_module("bddl.visible").visible(problem)
        sys.stderr.write(f"scene2demo: {problem}\n")
    return 2


def _parsed(arguments: list[str]) -> SubCommand:
    """Returns what was typed; nothing is said of what is wrong with it.

    Raises:
        SystemExit: It is not right, or help was asked for.
    """
    with redirect_stderr(StringIO()):
        return _parsed_as_said(arguments)


def _say_what_the_parser_says(arguments: list[str]) -> None:
    """Prints what is wrong with a command line, without what would steer the terminal."""
    if not all(argument.isprintable() for argument in arguments):
        legible = importlib.import_module("bddl.visible").visible
        arguments = [legible(argument) for argument in arguments]
    with suppress(SystemExit):
        _parsed_as_said(arguments)


def _parsed_as_said(arguments: list[str]) -> SubCommand:
    chosen: SubCommand = tyro.cli(
        SubCommand,
        prog="scene2demo",
        description=_DESCRIPTION,
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes, tyro.conf.DisallowNone),
    )
    return chosen


def _end(error: BaseException, options: Any) -> int:
    """Prints what an exception means and returns the exit code; re-raises a mistake of ours when asked to."""
    errors = importlib.import_module("executor.cli.errors")
    output = importlib.import_module("executor.cli.output")
    ending = errors.explain(error)
    if options.debug and not ending.expected:
        raise error
    if ending.kind == "unread":
        pass  # What is printed nobody reads.
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
