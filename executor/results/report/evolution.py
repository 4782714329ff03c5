"""The story of an evolution: attempts side by side, the failed step, what was changed, what came of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from difflib import SequenceMatcher

from bddl.visible import counted
from executor.evolution.frames import AttemptPictures, shown_step
from executor.evolution.record import Evolution, SubtaskStory
from executor.records.captions import action_text, readable
from executor.results.report.html import badge, bullets, card, fold, soft, strip, text
from oag import Action, ActionFlow, Attempt, Revision


def evolution_section(evolution: Evolution, pictures: AttemptPictures) -> str:
    """Returns the story of an episode's revisions; empty when there were none and nothing was given up.

    Args:
        evolution: The episode.
        pictures: What was drawn of its attempts.
    """
    stories = [story for story in evolution.stories if len(story.records) > 1 or story.gave_up is not None]
    if not stories:
        return ""
    ended = "reached its goal" if evolution.succeeded else "was given up"
    took = counted(evolution.revisions, "revision")
    parts = [soft(f"After {took} the task {ended}. Every attempt began from the same restored state.")]
    if evolution.faults:
        parts.append(f"{soft('Wrong on purpose:')}{bullets(evolution.faults)}")
    if not pictures.drawn:
        parts.append(soft(f"No pictures: {text(pictures.problem)}."))
    parts += [_story(evolution, story, pictures) for story in stories]
    return f"<h2 id='evolution'>How it evolved</h2>{''.join(parts)}"


def _story(evolution: Evolution, story: SubtaskStory, pictures: AttemptPictures) -> str:
    index = story.history.subtask
    name = readable(evolution.original.subtasks[index].name)
    state = badge("solved", "good") if story.solved else badge("not solved", "bad")
    attempts, before = [], None
    for number, (attempt, revision) in enumerate(story.history.iterations):
        drawn = pictures.drawn.get((index, number), {})
        attempts.append(_attempt(index, number, attempt, revision, before, drawn))
        before = attempt.flow
    gave_up = ""
    if story.gave_up is not None:
        reason = f"<p>{badge('gave up', 'bad')} {text(story.gave_up.reason)}</p>"
        gave_up = f"{reason}{_refused(story.gave_up.refused)}"
    title = f"<div class='row'><h3>{index + 1}. {text(name)}</h3>{state}</div>"
    return card(title, f"<div class='attempts'>{''.join(attempts)}</div>", gave_up)


def _attempt(
    index: int,
    number: int,
    attempt: Attempt,
    revision: Revision | None,
    before: ActionFlow | None,
    drawn: Mapping[str, Sequence[bytes]],
) -> str:
    won = attempt.succeeded
    label = badge("succeeded", "good") if won else badge(attempt.failure, "bad")
    flow = "".join(_flow(attempt.flow, before, None if won else shown_step(attempt)))
    message = f"<p>{text(attempt.message)}</p>" if attempt.message else ""
    faulty = (
        soft(f"<b>Step {critique.step + 1}.</b> {text(critique.text)}")
        for critique in attempt.critiques
        if critique.finds_fault and not won
    )
    rows = (
        strip(view, [(data, f"{view} view, picture {count}") for count, data in enumerate(pictures, start=1)])
        for view, pictures in drawn.items()
    )
    strips = f"<div class='strips'>{''.join(rows)}</div>" if drawn else ""
    return (
        f"<div class='attempt {'won' if won else 'lost'}'><div class='row'><b>Attempt {number + 1}</b>{label}</div>"
        f"<ol class='flow'>{flow}</ol>{message}{''.join(faulty)}{strips}{_therefore(index, attempt, revision)}</div>"
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
    were = "1 answer was" if len(answers) == 1 else f"{len(answers)} answers were"
    head = f"{were} refused before anything moved"
    return fold(head, bullets(answers, tag="ol"), kind="soft") if answers else ""
