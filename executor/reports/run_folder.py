"""The output folder of a run: its files, when they may be overwritten, and how they are written; pictures and video.

proposal.json     what was proposed, in the paper's names
exchanges.jsonl   with a model: every request and reply, for `--model replay:FILE`
conversation.json with a model: every round of questions, with what was wrong with each answer
conversations.json  with a model that judges: every round of critiques and revisions
usage.json        with a model: requests, tokens and cost, in all and by round
feasibility.json  what the dry run found, also where it refused the plan
certificate.json  the evidence for the verdict on task.json: `scene2demo recheck certificate.json --task task.json`
scene.json        the nominal scene
task.json         the task with the numbers that were run: `scene2demo rollout task.json --scene scene.json`
rollout.json      steps, evidence, judgements, hashes, checkpoints, and the concrete scene
evolution.json    every attempt with its critiques and the revision made of it (docs/models.md); only after evolution
pairs.jsonl       failures and their corrections as training examples, a line each; only after evolution
frames/           pictures of the steps that failed, where they were drawn
episode.hdf5      the demonstration (robomimic's layout)
video.mp4         three views with captions
report.html       all of it to read
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path

from bddl.errors import Scene2DemoError
from executor.data.episode import Episode
from executor.data.formats.robomimic import write_robomimic
from executor.records import Rollout, captions_of
from executor.reports.html import REPORT
from executor.reports.page import report_page
from executor.rollouts.evolution_record import FOLDER, Evolution, draw_attempts
from executor.rollouts.feasibility import Feasibility
from executor.rollouts.run_record import RunRecord, evolution_json, rollout_json, write_pairs
from executor.sim.render.frames import Frames, RenderFailed, RenderPool, VideoFailed, render, write_video
from executor.system.extras import MissingExtra, require
from executor.system.files import read_json, write_json, write_text
from executor.system.progress import OnProgress
from executor.system.vulkan import RendererNotFound
from llm.errors import LlmError

EXCHANGES, USAGE = "exchanges.jsonl", "usage.json"
FILES = (
    "proposal.json",
    EXCHANGES,
    "conversation.json",
    "conversations.json",
    USAGE,
    "certificate.json",
    "feasibility.json",
    "scene.json",
    "task.json",
    "rollout.json",
    "evolution.json",
    "pairs.jsonl",
    "episode.hdf5",
    "video.mp4",
    REPORT,
)
WORDS = (EXCHANGES, "conversation.json", "conversations.json")
"""Those of them that hold a model's answers."""


class ResultsExist(Scene2DemoError, FileExistsError):
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


class FolderUnusable(Scene2DemoError, OSError):
    """The output folder cannot be made or written."""

    def __init__(self, folder: Path, reason: str) -> None:
        super().__init__(f"the output folder {folder} cannot be used: {reason}")


@dataclass(frozen=True, slots=True)
class RunFolder:
    """A folder that is ready to take a run's files; make it with `prepare`.

    Attributes:
        path: The folder.
        kept_aside: Where the paid model answers of an earlier run are kept, when the run starts over.
    """

    path: Path
    kept_aside: Path | None = None

    @classmethod
    def prepare(cls, path: Path, *, force: bool = False, resume: bool = False) -> RunFolder:
        """Return the folder, made when absent; earlier results in it are removed only with `force`.

        Args:
            path: The folder.
            force: Removes earlier results; a recording of answers gets another name.
            resume: Leaves everything in place, for a run that goes on; `clear` removes what it replaces.

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
        """Remove the results of a resumed run; the model's answers stay."""
        _remove(self.path, [name for name in FILES if name not in WORDS])

    @contextmanager
    def filling(self) -> Iterator[None]:
        """Remove what was written when something breaks, such as a full disk; the next run finds no half-filled folder.

        The model's answers stay, since they were paid for; if the model failed, all files stay.
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
        """The file with every request to and reply from a model."""
        return self.path / EXCHANGES

    def write_conversation(self, conversation: object) -> None:
        """Write the rounds of questions to a model."""
        write_json(self.path / "conversation.json", conversation)

    def write_usage(self, usage: object) -> None:
        """Write what the models took; without room for it, nothing."""
        with suppress(OSError):
            write_json(self.path / USAGE, usage)

    @property
    def video(self) -> Path:
        """Where the video belongs."""
        return self.path / "video.mp4"

    def written(self) -> tuple[str, ...]:
        """Return the names of the result files that are there."""
        return tuple(name for name in FILES if (self.path / name).exists())

    def write_plan(self, record: RunRecord) -> None:
        """Write the plan: proposal, task, scene, and the certificate of that task."""
        if record.proposal is not None:
            write_json(self.path / "proposal.json", record.proposal)
        if record.report.certificate is not None:
            write_json(self.path / "certificate.json", record.report.certificate.to_json())
        else:
            (self.path / "certificate.json").unlink(missing_ok=True)
        write_json(self.path / "scene.json", record.graph.scene.to_json())
        write_json(self.path / "task.json", record.graph.task.to_json())

    def write_feasibility(self, found: Feasibility) -> None:
        """Write what the dry run found, with the repaired plan where there is one."""
        write_json(self.path / "feasibility.json", found.to_json())

    def write_rollout(self, record: RunRecord) -> RunRecord:
        """Write the rollout with the plan that ran, and return the record of that plan.

        Args:
            record: A run in which something moved, with the requested plan.
        """
        ran = record.as_ran()
        self.write_plan(ran)
        if ran.rollout is not None:
            write_json(self.path / "rollout.json", rollout_json(ran.rollout))
        return ran

    def write_evolution(self, record: RunRecord, evolution: Evolution) -> RunRecord:
        """Write the evolution of an episode, and return its record: the final plan, and its pictures.

        Args:
            record: The requested run, in the nominal scene.
            evolution: Its evolution.
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
        """Write the demonstration, with its sentence if one was typed; fewer than two samples leave no file."""
        if len(rollout.trajectory.time_s) >= 2:
            write_robomimic(self.path / "episode.hdf5", [Episode.from_rollout(rollout, frames, query)])

    def write_report(self, record: RunRecord, frames: Frames | None) -> None:
        """Write the page, with the video in it when there is one."""
        video = self.video if self.video.exists() else None
        files = [self.path / name for name in self.written() if name != REPORT]
        write_text(self.path / REPORT, report_page(record, frames, video, files))


def kept_aside(recording: Path) -> Path | None:
    """Rename a recording, for a run that starts over, and return its new path; None without a recording."""
    if recording.is_symlink() or not recording.is_file() or not recording.stat().st_size:
        return None
    return recording.rename(unused_path(recording.parent, recording.name))


def _remove(path: Path, names: Iterable[str]) -> None:
    for name in names:
        (path / name).unlink(missing_ok=True)
    for picture in (path / FOLDER).glob("T*_attempt*.jpg"):
        picture.unlink()


def unused_path(folder: Path, name: str) -> Path:
    """Return an unused path next to earlier files of the same name, such as `exchanges_2.jsonl`."""
    stem, dot, ending = name.partition(".")
    paths = (folder / (name if number == 1 else f"{stem}_{number}{dot}{ending}") for number in count(1))
    return next(path for path in paths if not path.exists() and not path.is_symlink())


def episode_folder(out: Path, seed: int) -> Path:
    """Return the folder of a seed's episode."""
    return out / f"seed_{seed:05d}"


@dataclass
class ResultsWriter:
    """Draws, encodes and writes the results of a run; its workers start while the physics runs.

    Attributes:
        wanted: Whether to make pictures and a video.
        size: Width and height of the robot's views; the overview is drawn twice as large.
        counting: Shows the progress of a part of the work.
        tell: Called with a sentence about what is left out.
        problem: Why there are no pictures; empty otherwise.
    """

    wanted: bool
    size: tuple[int, int]
    counting: Callable[[str], AbstractContextManager[OnProgress]]
    tell: Callable[[str], None]
    plain: bool = False
    problem: str = ""
    _pool: RenderPool | None = None
    _wall_s: dict[str, float] = field(default_factory=dict)

    def __enter__(self) -> ResultsWriter:
        if not self.wanted:
            self.problem = "switched off with --no-video"
            return self
        try:
            require("av", "data")
            self._pool = RenderPool()
            self._pool.start()
        except (RendererNotFound, MissingExtra) as missing:
            self.problem = str(missing)
        return self

    def __exit__(self, *exception: object) -> None:
        if self._pool is not None:
            self._pool.close()

    def finish(self, record: RunRecord, folder: RunFolder) -> RunRecord:
        """Write video, data set and report, and return the record with its pictures' state."""
        rollout = record.rollout
        if rollout is None:
            return record
        with tempfile.TemporaryDirectory(prefix="scene2demo-") as scratch:
            try:
                frames = None if record.interrupted else self._draw(rollout, Path(scratch), folder)
            except KeyboardInterrupt:
                frames, record = None, replace(record, interrupted=True)
            if record.interrupted and not self.problem:
                self.problem = "the run was interrupted"
            words = self.problem or (frames.renderer if frames is not None else "")
            began = time.perf_counter()
            try:
                folder.write_episode(rollout, frames, record.query or "")
            except MissingExtra as missing:
                self.tell(f"no dataset: {missing}")
            wall_s = {**record.wall_s, **self._wall_s, "dataset": time.perf_counter() - began}
            record = replace(record, pictures=words, wall_s=wall_s)
            folder.write_report(record, frames)
        return record

    def _draw(self, rollout: Rollout, scratch: Path, folder: RunFolder) -> Frames | None:
        if self._pool is None or len(rollout.trajectory.time_s) == 0:
            return None
        began = time.perf_counter()
        try:
            with self.counting("drawing pictures") as on_progress:
                frames = render(
                    rollout, scratch, size=self.size, plain=self.plain, on_progress=on_progress, pool=self._pool
                )
            self._wall_s["pictures"] = time.perf_counter() - began
            began = time.perf_counter()
            with self.counting("encoding the video") as on_progress:
                write_video(
                    folder.video, frames, captions_of(rollout), rate_hz=rollout.record_hz, on_progress=on_progress
                )
            self._wall_s["video"] = time.perf_counter() - began
        except (RenderFailed, VideoFailed) as problem:
            # What the robot did stands without pictures; the sentence goes into report and summary.
            self.problem = str(problem)
            return None
        return frames
