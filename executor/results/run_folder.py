"""The output folder of a run: which files it has, when they may be overwritten, and how they are written.

proposal.json     what was proposed, in the paper's names
exchanges.jsonl   with a model: every request and reply, for `--model replay:FILE`
conversation.json with a model: every round of questions, with what was wrong with each answer
conversations.json  with a model that judges: every round of critiques and revisions
certificate.json  the evidence for the verdict on task.json: `scene2demo recheck certificate.json --task task.json`
scene.json        the nominal scene
task.json         the task with the numbers that were run: `scene2demo rollout task.json --scene scene.json`
rollout.json      steps, evidence, judgements, hashes, checkpoints, and the concrete scene
evolution.json    every attempt with its critiques and the revision made of it (docs/evolution.md); only after evolution
pairs.jsonl       failures and their corrections as training examples, a line each; only after evolution
frames/           pictures of the steps that failed, where they were drawn
episode.hdf5      the demonstration (robomimic's layout)
video.mp4         three views with captions
report.html       all of it to read
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

from executor.evolution.frames import FOLDER, draw_attempts
from executor.evolution.record import Evolution
from executor.machine.files import read_json, write_json, write_text
from executor.pictures.frames import Frames
from executor.records.rollout import Rollout
from executor.results.episode import Episode
from executor.results.evolution_files import evolution_json, write_pairs
from executor.results.report.page import report_page
from executor.results.robomimic import write_robomimic
from executor.results.run_record import RunRecord, rollout_json
from llm.errors import LlmError

EXCHANGES = "exchanges.jsonl"
FILES = (
    "proposal.json",
    EXCHANGES,
    "conversation.json",
    "conversations.json",
    "certificate.json",
    "scene.json",
    "task.json",
    "rollout.json",
    "evolution.json",
    "pairs.jsonl",
    "episode.hdf5",
    "video.mp4",
    "report.html",
)
WORDS = (EXCHANGES, "conversation.json", "conversations.json")
"""Those of them that have a model's words."""


class ResultsExist(FileExistsError):
    """The folder has results of an earlier run."""

    def __init__(self, folder: Path, found: Iterable[str]) -> None:
        names = list(found)
        paid = EXCHANGES in names
        super().__init__(
            f"{folder} already has results ({', '.join(names)}); choose another folder with --out, "
            + (
                "go on from the recorded answers with --resume, or start over with --force, which keeps these aside"
                if paid
                else "or replace them with --force"
            )
        )


class FolderUnusable(OSError):
    """The output folder cannot be made or written."""

    def __init__(self, folder: Path, reason: str) -> None:
        super().__init__(f"the output folder {folder} cannot be used: {reason}")


@dataclass(frozen=True, slots=True)
class RunFolder:
    """A folder that is ready to take a run's files; make it with `prepare`.

    Attributes:
        path: The folder.
        kept_aside: Where the answers of a model are that an earlier run had paid for, when it starts over.
    """

    path: Path
    kept_aside: Path | None = None

    @classmethod
    def prepare(cls, path: Path, *, force: bool = False, resume: bool = False) -> RunFolder:
        """Returns the folder, made when absent; earlier results in it are removed only with `force`.

        Args:
            path: The folder.
            force: Removes earlier results; a recording of answers gets another name.
            resume: Leaves all as it is, for a run that goes on; `clear` removes what it replaces.

        Raises:
            ResultsExist: When it has results and `force` is not given.
            FolderUnusable: When it cannot be made or written.
        """
        try:
            path.mkdir(parents=True, exist_ok=True)
            # A link counts, wherever it leads: nothing is written through it.
            found = [name for name in (*FILES, FOLDER) if (path / name).is_symlink()]
            found += [name for name in FILES if (path / name).exists() and name not in found]
            if found and not (force or resume):
                raise ResultsExist(path, found)
            kept = None
            if not resume:
                kept = kept_aside(path / EXCHANGES)
                _remove(path, found)
            with tempfile.TemporaryFile(dir=path):
                pass
        except ResultsExist:
            raise
        except OSError as error:
            raise FolderUnusable(path, error.strerror or str(error)) from error
        return cls(path, kept)

    @property
    def query(self) -> str | None:
        """The sentence of the run whose results are there; None where they have none."""
        with suppress(OSError, ValueError):
            proposal = read_json(self.path / "proposal.json")
            query = proposal.get("query") if isinstance(proposal, dict) else None
            return query if isinstance(query, str) else None
        return None

    def clear(self) -> None:
        """Remove the results of a run that is gone on with; what a model has answered stays."""
        _remove(self.path, [name for name in FILES if name not in WORDS])

    @contextmanager
    def filling(self) -> Iterator[None]:
        """Takes what was written away again when something breaks, such as a full disk; the next run finds no half.

        What a model has answered stays, since it was paid for; where it is the model that failed, all stays.
        """
        try:
            yield
        except LlmError:
            raise
        except Exception as problem:
            with suppress(OSError):
                _remove(self.path, [name for name in FILES if name != EXCHANGES])
            if self.exchanges.exists():
                problem.add_note(f"What the model has answered is in {self.exchanges}; --resume goes on from it")
            raise

    @property
    def exchanges(self) -> Path:
        """Where everything said to and by a model is recorded."""
        return self.path / EXCHANGES

    def write_conversation(self, conversation: object) -> None:
        """Writes the rounds in which a model was asked."""
        write_json(self.path / "conversation.json", conversation)

    @property
    def video(self) -> Path:
        """Where the video belongs."""
        return self.path / "video.mp4"

    def written(self) -> tuple[str, ...]:
        """Returns the names of the result files that are there."""
        return tuple(name for name in FILES if (self.path / name).exists())

    def write_plan(self, record: RunRecord) -> None:
        """Writes what is known of the plan: proposal, task, scene, and the certificate of that task."""
        if record.proposal is not None:
            write_json(self.path / "proposal.json", record.proposal)
        if record.report.certificate is not None:
            write_json(self.path / "certificate.json", record.report.certificate.to_json())
        else:
            (self.path / "certificate.json").unlink(missing_ok=True)
        write_json(self.path / "scene.json", record.graph.scene.to_json())
        write_json(self.path / "task.json", record.graph.task.to_json())

    def write_rollout(self, record: RunRecord) -> RunRecord:
        """Writes what was executed, with the plan that ran, and returns the record of that plan.

        Args:
            record: The run, of which something moved, with the plan that was asked for.
        """
        ran = record.as_ran()
        self.write_plan(ran)
        if ran.rollout is not None:
            write_json(self.path / "rollout.json", rollout_json(ran.rollout))
        return ran

    def write_evolution(self, record: RunRecord, evolution: Evolution) -> RunRecord:
        """Writes how an episode evolved, and returns its record: the plan that was run in the end, and what was drawn.

        Args:
            record: The run as it was asked for, in the nominal scene.
            evolution: What became of it.
        """
        drawn = draw_attempts(evolution, self.path)
        done = replace(record, rollout=evolution.rollout, evolution=evolution, attempts=drawn)
        # What the folder calls the plan, and certifies, is the one that was run in the end.
        done = self.write_rollout(done)
        write_pairs(self.path / "pairs.jsonl", evolution, drawn.files)
        # Last, since an episode that has it counts as complete.
        write_json(self.path / "evolution.json", evolution_json(evolution) | {"stopped": record.stopped})
        return done

    def write_episode(self, rollout: Rollout, frames: Frames | None, query: str = "") -> None:
        """Write the demonstration of a sentence, where one was typed; one of fewer than two samples leaves no file."""
        if len(rollout.trajectory.time_s) >= 2:
            write_robomimic(self.path / "episode.hdf5", [Episode.from_rollout(rollout, frames, query)])

    def write_report(self, record: RunRecord, frames: Frames | None) -> None:
        """Writes the page, with the video in it when there is one."""
        video = self.video if self.video.exists() else None
        write_text(self.path / "report.html", report_page(record, frames, video))


def kept_aside(recording: Path) -> Path | None:
    """Return where a recording is kept, for a run that starts over; None where nothing was recorded."""
    if recording.is_symlink() or not recording.is_file() or not recording.stat().st_size:
        return None
    return recording.rename(unused(recording.parent, recording.name))


def _remove(path: Path, names: Iterable[str]) -> None:
    for name in names:
        (path / name).unlink(missing_ok=True)
    for picture in (path / FOLDER).glob("T*_attempt*.jpg"):
        picture.unlink()


def unused(folder: Path, name: str) -> Path:
    """Returns a path beside earlier files of the same name, such as `exchanges_2.jsonl`."""
    stem, dot, ending = name.partition(".")
    paths = (folder / (name if number == 1 else f"{stem}_{number}{dot}{ending}") for number in count(1))
    return next(path for path in paths if not path.exists() and not path.is_symlink())


def episode_folder(out: Path, seed: int) -> Path:
    """Returns where the episode of a seed belongs."""
    return out / f"seed_{seed:05d}"
