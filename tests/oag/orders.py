"""Every order in which the rules of the canonical form can be applied to a plan, and the forms that come out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import oag
from oag.normal_form.canonical import prepared
from oag.normal_form.order import ordered
from oag.normal_form.rules import changes
from oag.normal_form.survey import survey

Plan = tuple[oag.SimpleTask, ...]


class TooManyOrders(Exception):
    """A plan has more intermediate forms than were to be looked at."""


def forms(task: oag.Task, most: int = 1000) -> set[Plan]:
    """All forms that some order of changes leads to, names and descriptions left out.

    Raises:
        TooManyOrders: There are more than `most` intermediate forms.
    """
    assert task.scene is not None
    first = _unnamed(prepared(task, task.scene).subtasks)
    seen = {str(_said(first))}
    pending, found = [first], set()
    while pending:
        plan = pending.pop()
        following = list(_changed(plan, task.scene))
        if not following:
            found.add(plan)
        for other in following:
            if str(_said(other)) not in seen:
                seen.add(str(_said(other)))
                pending.append(other)
        if len(seen) > most:
            raise TooManyOrders
    return found


def _changed(plan: Plan, scene: oag.Scene) -> Iterator[Plan]:
    """Every plan that is one change away; the order of parts is changed when no rule applies."""
    places = survey(plan, scene)
    options = changes(places)
    for change in options:
        yield (*plan[: change.index], *change.result, *plan[change.index + change.count :])
    placed = ordered(places)
    if not options and placed != plan:
        yield placed


def _unnamed(plan: Sequence[oag.SimpleTask]) -> Plan:
    return tuple(replace(subtask, name="", detail="") for subtask in plan)


def _said(plan: Plan) -> list[dict[str, object]]:
    return [subtask.to_json() for subtask in plan]
