"""A folder of notes: what is recalled and why, what is learned, what is left out, and who tries it first."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

import oag
from llm.evolve import GiveUp, SearchSupervisor, Situation
from llm.memory import MemoryFolderError, RememberingSupervisor, SkillMemory, notes_for
from llm.memory_notes import Circumstances, circumstances, note_text, read_note, recall
from oag.model.actions import flow_from_json, flow_to_json
from oag.revision import Attempt, History, Revision
from tests.llm.evolve.attempts import failed, situation
from tests.llm.memory.notes import AJAR, CLOSED, TWICE, note, trial

SHORT = {"measurements": {"fraction_reached": 0.352, "fraction_asked": 0.35}}


def ajar(flow: list[Any] = AJAR) -> Attempt:
    """Return an attempt at closing the refrigerator that left it ajar."""
    return failed(flow_from_json(flow), 4, **SHORT)


def told() -> Situation:
    return situation("T1", 3, ajar())


def memory(folder: Path, *notes: Any) -> SkillMemory:
    """Return a memory with notes."""
    for one in notes:
        (folder / f"{one.name}.md").write_text(note_text(one), encoding="utf-8")
    return SkillMemory(folder)


def solved(*flows: list[Any], note: str = "") -> History:
    """Return the history of an evolution whose last flow succeeded; the note is that of its last revision."""
    history = History(3)
    for flow, following in pairwise(flows):
        last = following == flows[-1]
        said = "closed it further" if last else "at first it was closed a little further"
        revision = Revision(flow_from_json(following), "parameters", said, "limits", 4, note=note if last else "")
        history = history.add(replace(ajar(flow), seed=17000), revision)
    return history.add(Attempt(flow_from_json(flows[-1]), "succeeded", seed=17000))


def proposed_by(found: SkillMemory) -> Revision:
    """Return what a memory proposes for the refrigerator that was left ajar."""
    proposed = RememberingSupervisor(found, SearchSupervisor()).revise(told())
    assert isinstance(proposed, Revision)
    return proposed


def test_a_failure_is_compared_by_cause_primitive_kind_and_categories() -> None:
    of = circumstances(told().task, 3, told().scene, ajar())
    assert of == Circumstances(
        "the joint limits end too early",
        oag.Primitive.ARTICULATE_CLOSE,
        "close",
        told().scene["refrigerator_0"].category,
    )


def test_what_shares_more_is_recalled_first_and_says_why() -> None:
    of = Circumstances("the joint limits end too early", oag.Primitive.ARTICULATE_CLOSE, "close", "refrigerator")
    same, other = note(), note(target="microwave")
    far = note(cause="the fingers missed", primitive=oag.Primitive.GRASP, kind="pick", target="apple", support="table")
    otherwise = note(cause="the grip was lost")
    found = recall([far, other, otherwise, same], of)
    assert [one.note for one in found] == [same, other]
    assert found[0].why == ("cause 3", "ARTICULATE_CLOSE 2", "to close 2", "refrigerator 2") and found[0].score == 9
    assert found[1].why[-1] == "targets of one type 0.5"
    assert str(found[0]).endswith("9 points (cause 3, ARTICULATE_CLOSE 2, to close 2, refrigerator 2), helped 67%")


def test_a_cause_in_other_words_counts_by_the_words_and_an_unknown_one_by_the_rest() -> None:
    said = note(cause="the limits of the joint are too narrow")
    (found,) = recall([said], Circumstances("joint limits too small", said.primitive, "close", "refrigerator"))
    assert found.why[0] == "words of the cause 1.5"
    (found,) = recall([said], Circumstances("", said.primitive, "close", "refrigerator"))
    assert found.score == 6


def test_among_equals_what_helped_more_often_comes_first_and_what_never_helps_is_forgotten() -> None:
    of = Circumstances("the joint limits end too early", oag.Primitive.ARTICULATE_CLOSE, "close", "refrigerator")
    good = note(evidence=tuple(trial("t", seed, "succeeded") for seed in range(3)))
    poor = note(after=[*CLOSED, 6], evidence=(trial("t", 1, "failed"), trial("t", 2, "succeeded")))
    hopeless = note(after=[*CLOSED[:5], 5, 6, 6], evidence=tuple(trial("t", seed, "failed") for seed in range(3)))
    assert [one.note for one in recall([hopeless, poor, good], of)] == [good, poor]


def test_a_correction_is_learned_and_found_again(tmp_path: Path) -> None:
    first = SkillMemory(tmp_path)
    assert first.notes == () and first.learn(told().task, told().scene, [solved(AJAR, CLOSED)])
    again = SkillMemory(tmp_path)
    assert again.notes == first.notes and again.problems == ()
    (learned,) = again.notes
    assert (learned.cause, learned.kind, learned.lesson) == (
        "the joint limits end too early",
        "close",
        "closed it further",
    )
    assert (flow_to_json(learned.before), flow_to_json(learned.after)) == (AJAR, CLOSED)
    assert learned.evidence == (trial(told().task.name, 17000, "succeeded", 1),)
    assert (tmp_path / f"{learned.name}.md").is_file()


def test_the_same_episode_counts_once(tmp_path: Path) -> None:
    found = SkillMemory(tmp_path)
    found.learn(told().task, told().scene, [solved(AJAR, CLOSED)])
    assert found.learn(told().task, told().scene, [solved(AJAR, CLOSED)]) == ()
    assert len(found.notes[0].evidence) == 1


def test_detours_are_left_out(tmp_path: Path) -> None:
    found = SkillMemory(tmp_path)
    found.learn(told().task, told().scene, [solved(AJAR, [17, 1, 2, 3, {"19": [0.0, 0.55]}, 5], CLOSED)])
    (learned,) = found.notes
    assert (flow_to_json(learned.before), flow_to_json(learned.after)) == (AJAR, CLOSED)
    assert learned.evidence[0].revisions == 2


def test_what_was_not_solved_or_not_revised_teaches_nothing(tmp_path: Path) -> None:
    found = SkillMemory(tmp_path)
    unsolved = History(3).add(ajar())
    at_once = History(3).add(Attempt(flow_from_json(CLOSED), "succeeded"))
    assert found.learn(told().task, told().scene, [unsolved, at_once]) == () and found.notes == ()


def test_memory_is_tried_first_and_then_the_other(tmp_path: Path) -> None:
    proven = note(after=[*CLOSED, 6], evidence=TWICE)
    remembering = RememberingSupervisor(memory(tmp_path, proven), SearchSupervisor())
    first = remembering.revise(told())
    assert isinstance(first, Revision) and flow_to_json(first.flow) == [*CLOSED, 6]
    assert first.note == proven.name
    history = History(3).add(ajar(), first)
    second = remembering.revise(situation("T1", 3, ajar([*CLOSED, 6]), history))
    assert isinstance(second, Revision) and not second.note


def test_what_helped_once_waits_until_another_answer_has_failed(tmp_path: Path) -> None:
    once = note(after=[*CLOSED, 6])
    remembering = RememberingSupervisor(memory(tmp_path, once), SearchSupervisor())
    first = remembering.revise(told())
    assert isinstance(first, Revision) and not first.note
    history = History(3).add(ajar(), first)
    second = remembering.revise(situation("T1", 3, ajar([17, 1, 2, 3, {"19": [0.0, 0.6]}, 5]), history))
    assert isinstance(second, Revision) and second.note == once.name


def test_one_note_is_tried_for_a_cause(tmp_path: Path) -> None:
    notes = [note(after=[*CLOSED, 6], evidence=TWICE), note(after=[*CLOSED, 6, 6], evidence=TWICE)]
    remembering = RememberingSupervisor(memory(tmp_path, *notes), SearchSupervisor())
    first = remembering.revise(told())
    assert isinstance(first, Revision) and first.note
    history = History(3).add(ajar(), first)
    second = remembering.revise(situation("T1", 3, replace(ajar(), flow=first.flow), history))
    assert isinstance(second, Revision) and not second.note


def test_what_failed_for_an_earlier_subtask_is_no_lesson_about_this_one(tmp_path: Path) -> None:
    """Before the loop went back the item slipped; what is changed afterwards has another cause."""
    slipped = replace(failed(flow_from_json(AJAR), 4, failure="slipped", **SHORT), start="taken badly")
    back = Revision(flow_from_json([1, 2, 3, {"4": [0.0, 0.9]}, 5]), "parameters", "took it anew", subtask=1)
    onward = Revision(flow_from_json(CLOSED), "parameters", "closed it further", "limits", 4)
    history = History(3).add(slipped, back).add(replace(ajar(), start="taken well"), onward)
    done = Attempt(flow_from_json(CLOSED), "succeeded", seed=17000, start="taken well")
    found = SkillMemory(tmp_path)
    found.learn(told().task, told().scene, [history.add(done)])
    (learned,) = found.notes
    assert (learned.cause, learned.lesson) == ("the joint limits end too early", "closed it further")
    assert learned.evidence == (trial(told().task.name, 17000, "succeeded", 1),)


def test_what_memory_proposes_has_to_be_admissible(tmp_path: Path) -> None:
    unproved = note(after=[17, 1, 2, 5], evidence=TWICE)
    out_of_range = note(after=[17, 1, 2, 3, {"19": [0.0, 7.0]}, 5], evidence=TWICE)
    found = memory(tmp_path, unproved, out_of_range)
    assert len(found.notes) == 2
    answer = RememberingSupervisor(found, SearchSupervisor()).revise(told())
    assert answer == SearchSupervisor().revise(told()) and not isinstance(answer, GiveUp)


def test_a_note_that_fails_is_noted_as_failed(tmp_path: Path) -> None:
    wrong = note(after=[*CLOSED, 6], evidence=TWICE)
    found = memory(tmp_path, wrong)
    proposed = proposed_by(found)
    later = Revision(flow_from_json(CLOSED), "parameters", "closed it further", "limits", 4)
    history = History(3).add(ajar(), proposed).add(ajar([*CLOSED, 6]), later)
    found.learn(told().task, told().scene, [history.add(Attempt(flow_from_json(CLOSED), "succeeded"))])
    known = {one.name: one for one in SkillMemory(tmp_path).notes}
    assert [entry.outcome for entry in known[wrong.name].evidence] == ["succeeded", "succeeded", "failed"]
    assert {flow_to_json(one.after)[-1] for one in known.values()} == {5, 6}  # type: ignore[type-var]


def test_a_note_that_helps_again_gets_evidence_and_nothing_new_is_noted(tmp_path: Path) -> None:
    found = memory(tmp_path, note(evidence=TWICE))
    proposed = proposed_by(found)
    found.learn(told().task, told().scene, [solved(AJAR, CLOSED, note=proposed.note)])
    (kept,) = SkillMemory(tmp_path).notes
    assert [entry.outcome for entry in kept.evidence] == ["succeeded"] * 3


def test_evidence_says_how_many_revisions_there_were_until_then(tmp_path: Path) -> None:
    wrong = note(after=[*CLOSED, 6], evidence=TWICE)
    found = memory(tmp_path, wrong)
    proposed = proposed_by(found)
    searched = Revision(flow_from_json(AJAR), "parameters", "closed it a little further", "limits", 4)
    history = History(3).add(ajar(), searched).add(ajar(), proposed).add(ajar([*CLOSED, 6]))
    found.learn(told().task, told().scene, [history])
    (known,) = SkillMemory(tmp_path).notes
    assert [(entry.outcome, entry.revisions) for entry in known.evidence[1:]] == [("succeeded", 1), ("failed", 2)]


def test_a_model_that_says_it_used_a_note_changes_nothing_of_it(tmp_path: Path) -> None:
    kept = note(after=[*CLOSED, 6])
    found = memory(tmp_path, kept)
    claimed = Revision(
        flow_from_json(CLOSED),
        "parameters",
        f'From memory, note "{kept.name}": so it says',
        "limits",
        4,
        origin="model",
    )
    found.learn(told().task, told().scene, [History(3).add(ajar(), claimed).add(ajar(CLOSED))])
    assert SkillMemory(tmp_path).notes == (kept,)


def test_a_model_is_told_a_line_a_note(tmp_path: Path) -> None:
    (line,) = notes_for(memory(tmp_path, note()), told())
    assert "the joint limits end too early" in line and '{"19": [0.0, 0.86]}' in line and "\n" not in line


def test_what_is_no_sound_note_is_left_out_and_said(tmp_path: Path) -> None:
    outside = tmp_path / "outside.md"
    outside.write_text(note_text(note()), encoding="utf-8")
    folder = tmp_path / "memory"
    folder.mkdir()
    (folder / "link.md").symlink_to(outside)
    (folder / "folder.md").mkdir()
    (folder / "broken.md").write_text("+++\nnothing\n", encoding="utf-8")
    (folder / "bytes.md").write_bytes(b"+++\n\xff\n+++\n")
    (folder / "huge.md").write_bytes(b"x" * 1_000_000)
    (folder / "renamed.md").write_text(note_text(note()), encoding="utf-8")
    (folder / "notes.txt").write_text("not looked at", encoding="utf-8")
    found = SkillMemory(folder)
    assert found.notes == ()
    said = dict(line.split(": ", 1) for line in found.problems)
    assert set(said) == {"link.md", "folder.md", "broken.md", "bytes.md", "huge.md", "renamed.md"}
    assert said["link.md"] == "it is no plain file" and "belongs into" in said["renamed.md"]


def test_a_task_or_category_with_a_path_in_it_stays_in_the_folder(tmp_path: Path) -> None:
    folder = tmp_path / "memory"
    evil = replace(told().task, name="../../evil\x1b[2J")
    scene = told().scene
    objects = {key: replace(thing, category="../../../etc/passwd") for key, thing in scene.objects.items()}
    SkillMemory(folder).learn(evil, replace(scene, objects=objects), [solved(AJAR, CLOSED)])
    (path,) = tmp_path.rglob("*.md")
    assert path.parent == folder and read_note(path.read_text()).evidence[0].task == "../../evil [2J"


def test_a_folder_that_cannot_be_made_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(MemoryFolderError, match="cannot be used"):
        SkillMemory(tmp_path / "file")
