"""The story of an evolution: attempts side by side, the failed step, what was changed, what came of it."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from io import BytesIO

from PIL import Image

from bddl.visible import counted
from executor.evolution.frames import AttemptPictures, shown_step
from executor.evolution.record import Evolution, SubtaskStory
from executor.records.captions import action_text, readable
from executor.results.report.html import badge, picture_tag, text
from oag import Action, ActionFlow, Attempt, Critique, Revision


def evolution_section(evolution: Evolution, pictures: AttemptPictures) -> str:
    """Returns the story of an episode's revisions; empty when there were none and nothing was given up.

    Args:
        evolution: The episode.
        pictures: What was drawn of its attempts.
    """
    stories = [story for story in evolution.stories if len(story.records) > 1 or story.gave_up is not None]
    if not stories:
        return ""
    total = evolution.revisions
    ended = "reached its goal" if evolution.succeeded else "was given up"
    took = counted(total, "revision")
    lead = f"<p class='soft'>After {took} the task {ended}. Every attempt began from the same restored state.</p>"
    missing = f"<p class='soft'>No pictures: {text(pictures.problem)}.</p>" if not pictures.drawn else ""
    faults = "".join(f"<li><code>{text(fault)}</code></li>" for fault in evolution.faults)
    wrong = f"<p class='soft'>Wrong on purpose:</p><ul>{faults}</ul>" if faults else ""
    return f"<h2 id='evolution'>How it evolved</h2>{lead}{wrong}{missing}" + "".join(
        _story(evolution, story, pictures) for story in stories
    )


def _story(evolution: Evolution, story: SubtaskStory, pictures: AttemptPictures) -> str:
    index = story.history.subtask
    name = readable(evolution.original.subtasks[index].name)
    state = badge("solved", "good") if story.solved else badge("not solved", "bad")
    cards, before = [], None
    for number, (attempt, revision) in enumerate(story.history.iterations):
        drawn = pictures.drawn.get((index, number), {})
        cards.append(_card(index, number, attempt, revision, before, drawn))
        before = attempt.flow
    gave_up = ""
    if story.gave_up is not None:
        words = f"{badge('gave up', 'bad')} {text(story.gave_up.reason)}"
        gave_up = f"<p>{words}</p>{_refused(story.gave_up.refused)}"
    return (
        f"<div class='card'><div class='row'><h3>{index + 1}. {text(name)}</h3>{state}</div>"
        f"<div class='attempts'>{''.join(cards)}</div>{gave_up}</div>"
    )


def _card(
    index: int,
    number: int,
    attempt: Attempt,
    revision: Revision | None,
    before: ActionFlow | None,
    drawn: Mapping[str, Sequence[bytes]],
) -> str:
    tone = "won" if attempt.succeeded else "lost"
    label = badge("succeeded", "good") if attempt.succeeded else badge(attempt.failure, "bad")
    step = None if attempt.succeeded else shown_step(attempt)
    message = f"<p>{text(attempt.message)}</p>" if attempt.message else ""
    faulty = "".join(map(_critique, (c for c in attempt.critiques if c.finds_fault and not attempt.succeeded)))
    return (
        f"<div class='attempt {tone}'><div class='row'><b>Attempt {number + 1}</b>{label}</div>"
        f"<ol class='flow'>{''.join(_flow(attempt.flow, before, step))}</ol>{message}{faulty}"
        f"{_strips(drawn)}{_therefore(index, attempt, revision)}</div>"
    )


def _flow(flow: ActionFlow, before: ActionFlow | None, at_fault: int | None) -> Iterator[str]:
    """Yields the flow's lines; against the flow before it, what is new and what is gone is marked."""
    old = list(before) if before is not None else list(flow)
    for tag, a0, a1, b0, b1 in SequenceMatcher(None, old, list(flow), autojunk=False).get_opcodes():
        if tag in ("delete", "replace"):
            yield from (f"<li class='gone'>{text(_told(action))}</li>" for action in old[a0:a1])
        for step in range(b0, b1):
            kinds = [*(["new"] if tag != "equal" else []), *(["at-fault"] if step == at_fault else [])]
            yield f"<li class='{' '.join(kinds)}'>{step + 1}. {text(_told(flow[step]))}</li>"


def _told(action: Action) -> str:
    return action_text(action.primitive.name, action.to_json())


def _critique(critique: Critique) -> str:
    return f"<p class='soft'><b>Step {critique.step + 1}.</b> {text(critique.text)}</p>"


def _therefore(index: int, attempt: Attempt, revision: Revision | None) -> str:
    if revision is None:
        return ""
    back = revision.subtask is not None and revision.subtask < index
    if back and attempt.succeeded:
        words = f"Undone: subtask {(revision.subtask or 0) + 1} was revised, for the sake of a later one."
        return f"<p class='therefore soft'>{words}</p>"
    where = badge(f"back to subtask {(revision.subtask or 0) + 1}", "warn") if back else badge(revision.change, "quiet")
    return f"<div class='therefore'>{where}{_refused(revision.refused)}<p>{text(revision.explanation)}</p></div>"


def _refused(answers: Sequence[str]) -> str:
    """Returns the answers that were not let through, folded away."""
    if not answers:
        return ""
    were = "1 answer was" if len(answers) == 1 else f"{len(answers)} answers were"
    lines = "".join(f"<li>{text(answer)}</li>" for answer in answers)
    return f"<details class='soft'><summary>{were} refused before anything moved</summary><ol>{lines}</ol></details>"


def _strips(drawn: Mapping[str, Sequence[bytes]]) -> str:
    rows = []
    for view, pictures in drawn.items():
        shown = "".join(
            picture_tag(
                f"data:image/jpeg;base64,{base64.b64encode(data).decode('ascii')}",
                f"{view} view, picture {count}",
                Image.open(BytesIO(data)).size,
            )
            for count, data in enumerate(pictures, start=1)
        )
        rows.append(f"<div class='strip'><span>{text(view)}</span>{shown}</div>")
    return f"<div class='strips'>{''.join(rows)}</div>" if rows else ""
