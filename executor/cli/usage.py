"""What is wrong with a command line before anything is loaded: unknown words, and files that are not there."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import tyro

from executor.cli.words.datasets import DatasetOptions, DatasetSubCommand
from executor.cli.words.running import BddlOptions, BddlSubCommand, SubCommand
from executor.cli.words.shared import Read

TWO_WORDS = {("assets", "import"), ("bench", "replay"), ("bench", "photo")}
"""What belongs to a sub-command that takes words of its own cannot be one below it."""

_POSITIONAL = get_args(tyro.conf.Positional[str])[1]
_OF_ALL = ("--help",)
_OF_THE_PROGRAM = ("--help", "--version")
_BELOW: Mapping[type, object] = {BddlOptions: BddlSubCommand, DatasetOptions: DatasetSubCommand}


def commands(union: object = SubCommand) -> dict[str, type]:
    """Returns the options of each sub-command, by its name."""
    return {get_args(choice)[1].name: get_args(choice)[0] for choice in get_args(union)}


def option_names(options: type) -> tuple[str, ...]:
    """Returns the options of a sub-command, as they are typed; what follows it without a name is left out."""
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


def mistake(arguments: Sequence[str]) -> str:
    """Returns which command or option there is none of, and what it may have meant; else empty.

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
            return ""  # The parser says which there are.
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
    """Returns the legal words that are spelt nearly like one, or begin as it does; the likeliest first."""
    bare = {_bare(word): word for word in legal}
    name = _bare(typed)
    near = (name,) if name in bare else import_module("bddl").near_names(name, bare)
    begun = [word for word in bare if len(name) > 1 and (word.startswith(name) or name.startswith(word))]
    return [bare[word] for word in near or begun]


def _bare(word: str) -> str:
    return word.lstrip("-").removeprefix("no-")


def missing_input(options: object) -> str:
    """Returns which of the files that options name to be read is not there, as its reader would say; else empty."""
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
        return False  # Its reader says what is wrong with it.
    return False


def _metadata(hint: Any) -> tuple[Any, ...]:
    """Returns what is said beside a type, and beside the types of a union."""
    if get_origin(hint) is Annotated:
        return (*_metadata(get_args(hint)[0]), *get_args(hint)[1:])
    parts = get_args(hint) if get_origin(hint) in (Union, UnionType) else ()
    return tuple(found for part in parts for found in _metadata(part))
