"""An evolution on a terminal: the attempts at every subtask and what was changed between them, and the counts."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from bddl.visible import counted
from executor.evolution.record import Evolution
from executor.records.captions import readable
from oag import clopper_pearson, flow_to_json


def summary_of(episodes: Sequence[Mapping[str, Any]]) -> dict[str, object]:
    """Returns successes before and after evolution with exact 95 % intervals, and how many revisions they took.

    Args:
        episodes: Evolutions in their JSON form.
    """
    trials = len(episodes)
    before = sum(bool(episode["succeeded_at_once"]) for episode in episodes)
    after = sum(bool(episode["succeeded"]) for episode in episodes)
    evolved = [int(e["revisions"]) for e in episodes if e["succeeded"] and e["revisions"]]
    return {
        "trials": trials,
        "successes_before": before,
        "successes_after": after,
        "interval_95_before": clopper_pearson(before, trials) if trials else None,
        "interval_95_after": clopper_pearson(after, trials) if trials else None,
        "revisions_where_evolved_mean": sum(evolved) / len(evolved) if evolved else None,
    }


def story_lines(evolution: Evolution) -> Iterator[tuple[str, str | None]]:
    """Yields the table of the attempts at every subtask, with the revisions between them, and its styles."""
    for story in evolution.stories:
        mark, style = ("✓", "green") if story.solved else ("✗", "red")
        name = readable(story.records[-1].name)
        yield f"{mark} {story.history.subtask + 1} {name:44} {counted(len(story.records), 'attempt')}", style
        if len(story.records) == 1 and story.solved:
            continue
        for number, (attempt, revision) in enumerate(story.history.iterations, start=1):
            flow = json.dumps(flow_to_json(attempt.flow))
            yield f"    {number}  {flow}", None
            yield f"       {'succeeded' if attempt.succeeded else f'{attempt.failure}: {attempt.message}'}", None
            if revision is None:
                continue
            back = revision.subtask is not None and revision.subtask < story.history.subtask
            if back and attempt.succeeded:
                yield f"       undone, since T{(revision.subtask or 0) + 1} was revised", "yellow"
            else:
                where = f"back to T{(revision.subtask or 0) + 1}" if back else revision.change
                yield from _refused(revision.refused)
                yield f"       {where}: {revision.explanation}", "yellow"
        if story.gave_up is not None:
            yield from _refused(story.gave_up.refused)
            yield f"    gave up: {story.gave_up.reason}", "red"


def _refused(answers: Sequence[str]) -> Iterator[tuple[str, str | None]]:
    for answer in answers:
        yield f"       refused before it moved: {answer}", "dim"


def headline(episode: Mapping[str, Any]) -> str:
    """Returns an episode in a line.

    Args:
        episode: An evolution in its JSON form, with the wall time that it took where that is known.
    """
    revisions = int(episode["revisions"])
    words = "failed" if not episode["succeeded"] else "succeeded" if revisions else "succeeded at once"
    wall_s = episode.get("wall_s")
    took = "before" if wall_s is None else f"{wall_s:5.1f} s"
    made = counted(revisions, "revision")
    return f"seed {episode['seed']:4}  {took:>7}  {episode['state_hash'][:16]}  {made}  {words}"
