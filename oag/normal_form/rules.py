"""The rewriting rules of the canonical form. Each looks at one place of a plan and says what to put there instead.

No rule adds a subtask that the plan lacks, and none changes what the plan does: a rule drops what changes nothing,
joins what was cut in the middle of one movement, or cuts where the target is between two of its places.

Source: docs/canonical.md, Rules.
"""

from __future__ import annotations

from collections.abc import Sequence

from oag.normal_form.drop import drops
from oag.normal_form.join import join_movement
from oag.normal_form.rewrite import Rewrite, Rule
from oag.normal_form.survey import Place
from oag.normal_form.tidy import start_navigation, tidy_subtask
from oag.normal_form.transport import hoist_conditions, split_transport

STAGES: tuple[tuple[Rule, ...], ...] = (
    (split_transport,),
    (start_navigation, join_movement),
    (hoist_conditions, tidy_subtask),
)


def changes(places: Sequence[Place]) -> list[Rewrite]:
    """Returns all changes that may be made next: those of the first stage that has any, from the left.

    Movements are made whole before it is asked what is superfluous, since that hangs on what a subtask does as a whole.
    """
    for stage in STAGES:
        found = [change for index in range(len(places)) for rule in stage if (change := rule(places, index))]
        if found:
            return found
    return drops(places)
