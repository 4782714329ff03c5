"""The rewriting rules of the canonical form. Each looks at one place of a plan and says what to put there instead.

No rule adds a subtask that the plan lacks, and none changes what the plan does: a rule drops what changes nothing,
joins what was cut in the middle of one movement, or cuts where the target is between two of its places.

Source: docs/canonical.md, Rules.
"""

from __future__ import annotations

from oag.normal_form.drop import drop_done, drop_done_pair
from oag.normal_form.join import join_movement
from oag.normal_form.rewrite import Rule
from oag.normal_form.tidy import start_navigation, tidy_subtask
from oag.normal_form.transport import hoist_conditions, split_transport

RULES: tuple[Rule, ...] = (
    tidy_subtask,
    start_navigation,
    drop_done,
    drop_done_pair,
    join_movement,
    split_transport,
    hoist_conditions,
)
