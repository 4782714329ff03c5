"""Live progress on standard error: one moving line on a terminal, one line a step elsewhere."""

from __future__ import annotations

from rich.markup import escape
from rich.status import Status

from executor.cli.output import ERR, tell
from executor.records.captions import readable
from executor.records.rollout import Event


class RolloutProgress:
    """Listens to a rollout and shows how far it is.

    Args:
        quiet: Shows nothing.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self._quiet = quiet
        self._status: Status | None = None
        self._subtask = ""

    def __enter__(self) -> RolloutProgress:
        if not self._quiet and ERR.is_terminal:
            self._status = ERR.status("starting the physics")
            self._status.start()
        return self

    def __exit__(self, *exception: object) -> None:
        if self._status is not None:
            self._status.stop()

    def __call__(self, event: Event) -> None:
        """Shows one event."""
        if self._quiet:
            return
        if event.kind == "subtask-start":
            self._subtask = f"{event.subtask + 1}/{event.subtask_count} {readable(event.name)}"
            if self._status is None:
                tell(f"  {self._subtask}")
            else:
                self._status.update(escape(self._subtask))
        elif event.kind == "step-start":
            if self._status is not None:
                self._status.update(f"{escape(self._subtask)}: {event.name} ({event.simulated_s:.1f} s simulated)")
        elif event.kind == "revision":
            if self._status is None:
                tell(f"  back to {event.simulated_s:.1f} s: {event.message}")
            else:
                back_to = f"[yellow]back to {event.simulated_s:.1f} s[/]"
                ERR.print(f"  {back_to} {escape(self._subtask)}  {escape(event.message)}")
        elif event.kind == "step-end":
            if self._status is None:
                mark = "failed" if event.message else "done"
                tell(f"    {event.step + 1:2} {event.name:20} {mark:6} at {event.simulated_s:6.1f} s  {event.message}")
        elif self._status is not None:
            mark = "[red]failed[/]" if event.message else "[green]done[/]  "
            at = f"[dim]at {event.simulated_s:.1f} s[/]"
            ERR.print(f"  {mark} {escape(self._subtask)}  {at} {escape(event.message)}")
