"""The ablation's settings are the paper's, and its table says what was counted."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

from benchmarks.ablation import AblationRow, AblationSetting, look_back_settings, row_of, table, view_settings
from llm.structured.conversation import Conversation, Round


def episode(succeeded: bool, revisions: int, *latencies_s: float) -> Any:
    """Return an episode as far as the table looks at it, with a round for each latency."""
    conversation = Conversation("m", "q", "s")
    for number, latency_s in enumerate(latencies_s, start=1):
        conversation.entries.append(
            Round(6, number, "", "", "{}", (), True, input_tokens=100, output_tokens=10, latency_s=latency_s)
        )
    at_once = succeeded and revisions == 0
    return SimpleNamespace(succeeded=succeeded, succeeded_at_once=at_once, revisions=revisions), conversation


def test_every_subset_of_the_cameras_is_a_setting() -> None:
    assert [setting.letters for setting in view_settings(1)] == ["G", "H", "W", "G,H", "G,W", "H,W", "G,H,W"]
    assert {setting.look_back for setting in view_settings(1)} == {1}


def test_the_windows_are_none_one_and_two() -> None:
    assert look_back_settings(("head",)) == tuple(AblationSetting(("head",), p1) for p1 in (0, 1, 2))


def test_a_row_counts_what_was_said_and_what_came_of_it() -> None:
    row = row_of(
        AblationSetting(("global", "head"), 1),
        [episode(True, 0), episode(True, 2, 1.0, 2.0), episode(False, 5, 3.0)],
    )
    assert (row.trials, row.before, row.after, row.revisions) == (3, 1, 2, (0, 2))
    assert (row.questions, row.input_tokens, row.output_tokens) == (3, 300, 30)
    assert (row.mean_revisions, row.mean_latency_s) == (1.0, 2.0)
    data = cast("dict[str, Any]", row.to_json())
    assert data["views"] == ["global", "head"] and data["waited_s"] == 6.0
    low, high = data["interval_95_after"]
    assert low < 2 / 3 < high


def test_the_table_is_markdown_and_says_where_there_is_nothing() -> None:
    nothing = AblationRow(AblationSetting((), 2), 1, 0, 0, (), 0, 0, 0, ())
    some = row_of(AblationSetting(("wrist",), 0), [episode(True, 1, 4.0)])
    assert table([some, nothing]).splitlines() == [
        "| views | p1 | success | at once | revisions | questions | tokens in + out | s an answer |",
        "|-------|----|---------|---------|-----------|-----------|-----------------|-------------|",
        "| W     | 0  | 1/1     | 0/1     | 1.00      | 1         | 100 + 10        | 4.0         |",
        "| -     | 2  | 0/1     | 0/1     | -         | 0         | 0 + 0           | -           |",
    ]
