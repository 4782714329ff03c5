"""An array job under a stand-in for Slurm: parts that are killed, or told to end, lose and double nothing."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import textwrap
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from executor.campaign.claims import claim_units, runs_in
from executor.campaign.slurm import ArrayJob, parts_for
from executor.cli.app import run
from executor.cli.commands.generate import Options
from executor.cli.engines import typed_words

STUB = Path(__file__).with_name("stub_campaign.py")
UNITS, PARTS, KILLED = 200, 40, 5
TASK_S = 60.0


class StandIn:
    """What of Slurm the script needs: an array of tasks, a requeue, a dependency that follows all.

    Args:
        script: The script.
        folder: Folder for the commands `sbatch` and `scontrol`, which the script finds on its path.
    """

    def __init__(self, script: Path, folder: Path) -> None:
        self._script, self._calls = script, folder / "calls"
        folder.mkdir()
        for name in ("sbatch", "scontrol"):
            tool = folder / name
            tool.write_text(f'#!/bin/bash\necho "{name} $*" >> {self._calls}\n', encoding="utf-8")
            tool.chmod(0o755)
        self._calls.touch()
        self._path = f"{folder}{os.pathsep}{os.environ['PATH']}"
        self.starts: Counter[int] = Counter()
        self.killed: set[int] = set()

    @property
    def calls(self) -> list[str]:
        """Command lines of `sbatch` and `scontrol`."""
        return self._calls.read_text(encoding="utf-8").splitlines()

    def task(self, number: int, *, kill: signal.Signals | None = None, after_s: float = 0.0) -> int:
        """Run a task; it may be killed with all its processes, as with its machine, or told to end."""
        variables = {"SLURM_ARRAY_JOB_ID": "77", "SLURM_ARRAY_TASK_ID": str(number), "SLURM_CPUS_PER_TASK": "1"}
        if self.starts[number]:
            variables["SLURM_RESTART_COUNT"] = str(self.starts[number])
        self.starts[number] += 1
        environment = {**os.environ, **variables, "PATH": self._path, "PYTHONPATH": os.pathsep.join(sys.path)}
        task = subprocess.Popen(["bash", str(self._script)], env=environment, start_new_session=True)
        try:
            return task.wait(TASK_S if kill is None else after_s)
        except subprocess.TimeoutExpired:
            if kill is None:
                raise
            self.killed.add(number)
            if kill is signal.SIGKILL:
                os.killpg(task.pid, kill)
            else:
                task.send_signal(kill)  # Slurm tells the batch shell alone (`--signal=B:`).
            return task.wait(TASK_S)

    def array(self, last: int) -> dict[int, int]:
        """Run the tasks 1 to `last`, some at once, and start the killed ones again; return their exit codes."""
        victims = {number: 0.5 for number in range(3, last + 1, last // KILLED)}

        def one(number: int) -> int:
            if number not in victims:
                return self.task(number)
            code = self.task(number, kill=signal.SIGKILL, after_s=victims[number])
            return code if number not in self.killed else self.task(number)

        with ThreadPoolExecutor(8) as pool:
            return dict(zip(range(1, last + 1), pool.map(one, range(1, last + 1)), strict=True))


def job(tmp_path: Path, units: int, parts: int, seconds: float) -> tuple[ArrayJob, Path, Path]:
    out, file = tmp_path / "out", tmp_path / "job.sh"
    out.mkdir()
    command = [sys.executable, str(STUB), str(out), str(units), str(seconds)]
    made = ArrayJob(command, file, tmp_path, tmp_path / "logs", parts, 1)
    file.write_text(made.script(), encoding="utf-8")
    return made, out, file


def done(out: Path) -> list[str]:
    return sorted(path.name for path in out.glob("v-*"))


@pytest.mark.slow
def test_two_hundred_units_in_forty_parts_five_of_which_lose_their_machine(tmp_path: Path) -> None:
    _, out, file = job(tmp_path, UNITS, PARTS, 0.15)
    slurm = StandIn(file, tmp_path / "tools")
    codes = slurm.array(PARTS)
    assert set(codes.values()) == {0} and len(slurm.killed) == KILLED
    # A unit's file is made once only: one that ran to its end twice would have ended its part with an error.
    assert done(out) == [f"v-{number:04d}" for number in range(UNITS)]
    assert slurm.calls == [f"sbatch --array=0 --dependency=afterany:77 {file}"]
    assert slurm.task(0) == 0 and not any(run.lives for run in runs_in(out))


def test_a_part_whose_time_is_up_asks_to_be_started_again_and_goes_on(tmp_path: Path) -> None:
    _, out, file = job(tmp_path, 6, 2, 0.4)
    slurm = StandIn(file, tmp_path / "tools")
    assert slurm.task(2, kill=signal.SIGTERM, after_s=1.2) == 0
    assert slurm.calls == ["scontrol requeue 77_2"]
    before = done(out)
    assert len(before) < 3 and not any(run.lives for run in runs_in(out))
    assert slurm.task(2) == 0 and slurm.calls == ["scontrol requeue 77_2"]
    assert len(done(out)) == 3
    # The last step makes what a part never did.
    assert slurm.task(0) == 0 and len(done(out)) == 6


def test_two_starts_of_one_request_run_no_unit_twice(tmp_path: Path) -> None:
    # The file of a unit is made once only, so that one that ran twice ends its run with an error.
    command = [sys.executable, str(STUB), str(tmp_path), "3", "0.3"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    runs = [subprocess.Popen(command, env=environment) for _ in range(2)]
    assert [run.wait(TASK_S) for run in runs] == [0, 0]
    assert done(tmp_path) == [f"v-{number:04d}" for number in range(3)]


def test_the_last_step_goes_where_the_parts_are_and_a_refusal_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, _, file = job(tmp_path, 0, 1, 0.0)
    slurm = StandIn(file, tmp_path / "tools")
    for name, value in (("JOB_PARTITION", "short"), ("JOB_ACCOUNT", "a b"), ("MEM_PER_NODE", "4000")):
        monkeypatch.setenv(f"SLURM_{name}", value)
    assert slurm.task(1) == 0
    assert slurm.calls == [
        f"sbatch --array=0 --dependency=afterany:77 --partition=short --account=a b --mem=4000 {file}"
    ]
    with (tmp_path / "tools" / "sbatch").open("a", encoding="utf-8") as tool:
        tool.write("exit 9\n")
    slurm.starts.clear()
    assert slurm.task(1) == 9


@pytest.mark.parametrize(("code", "ends"), [(0, 0), (1, 1), (2, 2), (3, 3), (130, 0), (143, 0)])
@pytest.mark.parametrize("number", [0, 2])
def test_a_part_ends_as_its_command_unless_it_is_started_again(
    code: int, ends: int, number: int, tmp_path: Path
) -> None:
    file = tmp_path / "job.sh"
    made = ArrayJob(["bash", "-c", f"exit {code}"], file, tmp_path, tmp_path / "logs", 2, 1)
    file.write_text(made.script(), encoding="utf-8")
    slurm = StandIn(file, tmp_path / "tools")
    assert slurm.task(number) == ends
    assert slurm.calls == ([f"scontrol requeue 77_{number}"] if code > 100 else [])


def test_the_outputs_may_lie_in_any_folder(tmp_path: Path) -> None:
    made = ArrayJob(["true"], tmp_path / "f", tmp_path, Path("/a b/100%A #1"), 1, 1)
    assert '#SBATCH --output="/a b/100%%A #1/%A_%a.log"' in made.script().splitlines()


def test_a_request_for_parts_is_refused_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes").write_text("mine", encoding="utf-8")
    (tmp_path / "plan.yaml").write_text("successes: 2\nsources: [{families: [T3]}]", encoding="utf-8")
    asked = ["generate", "T3", "--episodes", "2", "--out"]
    for words in (
        [*asked, "d", "--slurm", "notes"],
        [*asked, "d", "--slurm", "."],
        [*asked, "d", "--slurm", "job\nrm x"],
        [*asked, 'd"', "--slurm", "job"],
        [*asked, "d", "--slurm", "job", "--hours", "inf"],
        [*asked, "d", "--slurm", "job", "--limit-h", "1"],
        [*asked, "d", "--slurm", "job", "--limit-gb", "1"],
        ["generate", "plan.yaml", "--out", "d", "--slurm", "job"],
        ["generate", "plan.yaml", "--out", "d", "--shard", "1/2"],
    ):
        assert run(words) == 2, words
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes", "plan.yaml"]
    assert (tmp_path / "notes").read_text(encoding="utf-8") == "mine"
    # An array job of ours is replaced.
    assert run([*asked, "d", "--slurm", "job"]) == run([*asked, "d", "--slurm", "job"]) == 0


def test_the_script_is_one_that_bash_reads_and_sbatch_understands(tmp_path: Path) -> None:
    made, _, file = job(tmp_path, 6, 2, 0.0)
    assert subprocess.run(["bash", "-n", str(file)], check=False).returncode == 0
    lines = made.script().splitlines()
    # Slurm reads settings up to the first command.
    first = next(number for number, line in enumerate(lines) if line and not line.startswith("#"))
    settings = [line for line in lines[:first] if line.startswith("#SBATCH")]
    assert len(settings) == sum(line.startswith("#SBATCH") for line in lines)
    assert {"#SBATCH --array=1-2", "#SBATCH --requeue", "#SBATCH --signal=B:TERM@120"} <= set(settings)
    assert all(re.fullmatch(r"#SBATCH --[a-z-]+(=\S+)?", line) for line in settings)


def test_parts_are_small_and_no_more_than_an_array_has() -> None:
    assert [parts_for(units) for units in (0, 1, 20, 21, 800, 10**6)] == [1, 1, 1, 2, 40, 1000]


def test_the_command_of_a_part_has_what_was_typed_and_no_engine(tmp_path: Path) -> None:
    options = Options(
        what=("open it", "now"), out=tmp_path, slurm=tmp_path / "f", vary=("target",), evolve=True, json=True, workers=7
    )
    words = typed_words("generate", options, "what")
    assert words == [
        *(sys.executable, "-m", "executor", "generate", "open it", "now"),
        *("--out", str(tmp_path), "--vary", "target", "--evolve"),
    ]


def test_generate_writes_the_job_and_status_knows_what_it_is_about(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    asked = ["generate", "T3", "--episodes", "45", "--out", "d", "--slurm", "job.sh", "--workers", "3"]
    assert run(asked) == 0
    said = capsys.readouterr().out
    assert "45 units in 3 parts" in said and "sbatch job.sh" in said
    script = (tmp_path / "job.sh").read_text(encoding="utf-8")
    assert "--array=1-3" in script and "generate T3" in script and "--cpus-per-task=3" in script
    assert "--slurm" not in script
    assert run(["status", "d"]) == 0
    assert "0 of 45 (0 %): nothing yet" in capsys.readouterr().out
    assert run([*asked, "--shard", "1/2"]) == 2
    assert run(["generate", "T3", "--out", "d", "--parts", "3"]) == 2


def test_runs_that_ended_are_told_from_those_that_live(tmp_path: Path) -> None:
    code = textwrap.dedent(
        """
        import os, pathlib, signal, sys
        from executor.campaign.claims import claim_units
        with claim_units(pathlib.Path(sys.argv[1]), ["a", "b"]):
            os.kill(os.getpid(), signal.SIGKILL)
        """
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], env=environment, check=False)
    with claim_units(tmp_path, ["c"]):
        found = {run.units: run.lives for run in runs_in(tmp_path)}
        # To look changes nothing: whoever wants these units may have them, and the living run keeps its own.
        assert found == {frozenset("ab"): False, frozenset("c"): True} == {r.units: r.lives for r in runs_in(tmp_path)}
    with claim_units(tmp_path, ["a", "b", "c"]):
        assert [run.units for run in runs_in(tmp_path)] == [frozenset("abc")]
