"""`scene2demo evolve`: executes a task file, revising the flows that fail, and tells every attempt.

Returns 0 when every episode succeeded in the end, 1 when one did not or the plan is not proved, 130 after Ctrl-C.
"""

from __future__ import annotations

import json
import shlex
import time
from pathlib import Path
from typing import Any

from executor.cli.options.bad_option import BadOption
from executor.cli.options.evolution import Evolve as EvolveOptions
from executor.cli.options.fault_words import FaultWords
from executor.cli.options.inputs import check_seed, task_to_run
from executor.cli.terminal.errors import DONE, FAILED, INTERRUPTED
from executor.cli.terminal.evolution_story import headline, story_lines, summary_of
from executor.cli.terminal.output import print_json, say, tell, tell_notes
from executor.cli.terminal.progress import RolloutProgress
from executor.cli.terminal.refused import refuse
from executor.cli.work.attempt_frames import attempt_frames
from executor.cli.work.judging import Judging, judged_words
from executor.evolution.evolve import evolve
from executor.evolution.record import Evolution, EvolutionInterrupted
from executor.machine.extras import MissingExtra, require
from executor.machine.files import json_text, read_json
from executor.results.evolution_files import evolution_json
from executor.results.run_folder import RunFolder, episode_folder
from executor.results.run_record import RunRecord
from executor.world.faults import fault_json
from oag import ObjectActionGraph, Scene, compose
from oag.task.sizes import resizings


def execute(options: EvolveOptions) -> int:
    """Runs the episodes, prints their attempts, and returns the exit code."""
    check_seed(options.seed, options.episodes)
    if options.limit < 0:
        raise BadOption("--limit", options.limit, "0 or more")
    if options.resume and options.out is None:
        raise BadOption("--resume", "is given without --out", "the folder of the episodes to go on from")
    faults = tuple(FaultWords.parse(words) for words in options.fault)
    task, scene = task_to_run(options.task, options.scene)
    for words in faults:
        if words.object_id is not None:
            scene[words.object_id]  # Says which objects there are when it is none.
    graph = compose(task, scene=scene)
    report = graph.verify()
    if not report:
        return refuse(report, as_json=options.json)
    notes = tuple(map(str, resizings(task.scales, scene)))
    if not options.json:
        tell_notes(notes)
    episodes = _Episodes(options, faults, graph, scene)
    interrupted = False
    try:
        episodes.run()
    except EvolutionInterrupted:
        interrupted = True
    told = episodes.told
    good = not interrupted and all(episode["succeeded"] for episode in told)
    code = INTERRUPTED if interrupted else DONE if good else FAILED
    if options.json:
        head = {"ok": good, "exit_code": code, "interrupted": interrupted, "notes": list(notes)}
        print_json({**head, **summary_of(told), "episodes": told})
    else:
        _print(episodes, options)
        if interrupted:
            tell("scene2demo: interrupted; finished episodes were kept, --resume goes on", style="yellow")
    return code


class _Episodes:
    """The episodes of one command: those that the folder has, and those that are run.

    Attributes:
        told: Their evolutions in JSON form, in the order of seeds.
        last: The last one that was run here.
    """

    def __init__(
        self, options: EvolveOptions, faults: tuple[FaultWords, ...], graph: ObjectActionGraph, scene: Scene
    ) -> None:
        self._options, self._faults, self._graph, self._scene = options, faults, graph, scene
        self.told: list[dict[str, Any]] = []
        self.last: Evolution | None = None
        seeds = range(options.seed, options.seed + options.episodes)
        kept = {seed: self._kept(seed) for seed in seeds} if options.resume else {}
        self._kept_ones = {seed: told for seed, told in kept.items() if told is not None}
        self._folders: dict[int, RunFolder] = {}
        for seed in seeds:
            if options.out is not None and seed not in self._kept_ones:
                # An episode that was interrupted has no evolution.json, and is run again.
                force = options.force or options.resume
                self._folders[seed] = RunFolder.prepare(episode_folder(options.out, seed), force=force)

    def run(self) -> None:
        """Runs what is left to run.

        Raises:
            EvolutionInterrupted: Ctrl-C.
        """
        options = self._options
        with (
            Judging(options.judged, options.out, force=options.force, resume=options.resume) as judging,
            attempt_frames(judging.frames, wanted=options.pictures) as frames,
            RolloutProgress(quiet=options.json or options.episodes > 1) as progress,
        ):
            for seed in range(options.seed, options.seed + options.episodes):
                told = self._kept_ones.get(seed)
                if told is None:
                    began = time.perf_counter()
                    inspector, supervisor = judging.judges(self._graph.task.name, self._scene)
                    self.last = evolve(
                        self._graph,
                        self._scene,
                        seed,
                        inspector=inspector,
                        supervisor=supervisor,
                        limit=options.limit,
                        listen=progress,
                        faults=tuple(words.drawn(seed) for words in self._faults),
                        frames=frames,
                    )
                    judging.learn(self.last)
                    told = evolution_json(self.last) | {"wall_s": time.perf_counter() - began}
                    self._write(seed, self.last)
                self.told.append(told)
                if not options.json and options.episodes > 1:
                    say(headline(told), style="green" if told["succeeded"] else "red")

    def _write(self, seed: int, evolution: Evolution) -> None:
        folder = self._folders.get(seed)
        if folder is None:
            return
        with folder.filling():
            record = RunRecord(self._graph, self._graph.verify(), command=_command(self._options, seed))
            folder.write_report(folder.write_evolution(record, evolution), None)
            try:
                require("h5py", "data")
            except MissingExtra as missing:
                tell(f"no dataset: {missing}", style="yellow")
            else:
                folder.write_episode(evolution.rollout, None)

    def _kept(self, seed: int) -> dict[str, Any] | None:
        """Returns an episode that the folder has, None when it has none.

        Raises:
            BadOption: It is one of another experiment.
        """
        if self._options.out is None:
            return None
        path: Path = episode_folder(self._options.out, seed) / "evolution.json"
        try:
            told = read_json(path)
        except (OSError, ValueError):
            return None
        faults = [fault_json(words.drawn(seed)) for words in self._faults]
        asked = {"original": self._graph.task.to_json(), "faults": faults, "seed": seed}
        if not isinstance(told, dict) or any(
            told.get(key) != json.loads(json_text(value)) for key, value in asked.items()
        ):
            raise BadOption("--resume", path, "episodes of the same task with the same faults")
        return told


def _command(options: EvolveOptions, seed: int) -> str:
    words = ["scene2demo", "evolve", str(options.task), "--scene", options.scene, "--seed", str(seed)]
    faults = [word for fault in options.fault for word in ("--fault", fault)]
    return shlex.join([*words, "--limit", str(options.limit), *faults, *judged_words(options.judged)])


def _print(episodes: _Episodes, options: EvolveOptions) -> None:
    told = episodes.told
    if options.episodes == 1 and told:
        for text, style in () if episodes.last is None else story_lines(episodes.last):
            say(text, style=style)
        say(headline(told[0]), style="green" if told[0]["succeeded"] else "red")
    elif told:
        counts = summary_of(told)
        say(
            f"{counts['successes_before']} of {counts['trials']} succeeded at once, "
            f"{counts['successes_after']} after evolution"
        )
    if options.out is not None:
        say(f"results in {options.out}")
