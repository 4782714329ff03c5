"""Map every exception to an exit code and one clear message.

Exit codes: 0 done; 1 the work ran and failed (a plan that is not proved, a failed rollout, a rejected certificate), and
also a mistake of this program, of which `--debug` shows the traceback; 2 misuse or bad input; 3 the disk is full; 130
Ctrl-C; 141 the reader of the output is gone, as after `| head`: as for other commands in a shell.
"""

from __future__ import annotations

import errno
from dataclasses import dataclass

from bddl.errors import Scene2DemoError
from bddl.files import is_disk_full

DONE, FAILED, BAD_INPUT, DISK_FULL, INTERRUPTED, UNREAD = 0, 1, 2, 3, 130, 141

# By the system's number: what helps is not the same.
_ADVICE = {
    errno.ENOSPC: "make room",
    errno.EDQUOT: "make room within your share of the disk",
    errno.EFBIG: "the disk has room, but no file may grow so large here: raise the limit (ulimit -f)",
}


class BadOption(Scene2DemoError, ValueError):
    """An option has a value that cannot be used."""

    def __init__(self, option: str, value: object, expected: str) -> None:
        super().__init__(f"{option} {value}: expected {expected}")


def check(good: bool, option: str, value: object, expected: str) -> None:
    """Refuse an option's value that is not good."""
    if not good:
        raise BadOption(option, value, expected)


@dataclass(frozen=True, slots=True)
class Ending:
    """The end of a command.

    Attributes:
        code: Exit code.
        kind: Short name of the error, for `--json`.
        message: Message for a person.
        expected: False for a mistake of this program.
    """

    code: int
    kind: str
    message: str
    expected: bool = True


def explain(error: BaseException) -> Ending:
    """Return the ending of a command for an exception."""
    if isinstance(error, KeyboardInterrupt):
        return Ending(INTERRUPTED, "interrupted", str(error) or "interrupted")
    if isinstance(error, BrokenPipeError):
        return Ending(UNREAD, "unread", "")
    kind = type(error).__name__
    if (full := _full_disk(error)) is not None:
        where = str(error) if error is not full else f"{full.filename or 'the disk'}: {full.strerror}"
        notes = "".join(f". {note}" for note in getattr(error, "__notes__", ()))
        advice = f"{_ADVICE[full.errno or 0]}, and type the same command again"
        return Ending(DISK_FULL, "disk-full", f"{where}; {advice}{notes}")
    if isinstance(error, Scene2DemoError):
        return Ending(error.exit_code, kind, str(error))
    if isinstance(error, OSError) and error.filename is not None:
        return Ending(BAD_INPUT, kind, f"{error.filename}: {error.strerror or error}")
    words = f"{kind}: {error}" if str(error) else kind
    return Ending(
        FAILED,
        "unexpected",
        f"an unexpected error stopped the command: {words}\nRun it again with --debug to see where.",
        expected=False,
    )


def _full_disk(error: BaseException | None) -> OSError | None:
    """Return the system's error that nothing more can be written, if it caused an exception."""
    while error is not None:
        if isinstance(error, OSError) and is_disk_full(error):
            return error
        error = error.__cause__
    return None
