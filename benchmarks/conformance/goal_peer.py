"""The reference implementation in a process of its own, asked about goals; see `reference_goals`."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import bddl

SCRIPT = Path(__file__).with_name("reference_goals.py")


class GoalPeer:
    """A running reference.

    Args:
        interpreter: The Python of an environment that has the reference, and not this project, as `bddl`.
        script: What it runs: reads a JSON request a line and writes a JSON answer a line.
    """

    def __init__(self, interpreter: Path, script: Path = SCRIPT) -> None:
        # Started elsewhere, so that the checkout's own `bddl` cannot be found first.
        self._process = subprocess.Popen(
            [str(interpreter.absolute()), str(script)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            cwd=interpreter.parent,
        )

    def __enter__(self) -> GoalPeer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.terminate()
        self._process.communicate()

    def ask(self, do: str, **request: object) -> Any:
        """Return the answer to one request.

        Raises:
            RuntimeError: The reference failed at it.
        """
        print(json.dumps({"do": do, **request}), file=self._process.stdin, flush=True)
        line = self._process.stdout.readline() if self._process.stdout else ""
        if not line:
            raise RuntimeError(f"the reference failed at {do} {request.get('activity', '')}")
        return json.loads(line)

    def problems(self) -> dict[str, bddl.Problem]:
        """Return every activity of the reference's installation, read by this project as the reference reads it."""
        paths = self.ask("list")
        return {
            name: bddl.parse(Path(path).read_text(encoding="utf-8"), profile="behavior-compat")
            for name, path in paths.items()
        }

    def load(self, activity: str, atoms: Sequence[bddl.Atom], *, checked: bool = False) -> int:
        """Compiles the goal of an activity; returns how many conditions it has.

        Args:
            activity: Its name.
            atoms: The atoms that states speak of, in order.
            checked: Fail when the reference asks about any other atom.
        """
        return int(self.ask("load", activity=activity, atoms=[atom.label for atom in atoms], checked=checked))
