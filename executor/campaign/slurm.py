"""Write the Slurm array job of a campaign: many small parts, and one step at the end that finds all done.

Parts are shards of one request in one folder. A part whose machine is lost, or whose time is up, is started again by
Slurm and leaves out what is there. When no part is left, task 0 runs the same request whole: it makes what a part could
not, and writes tables and index. Nothing of it is a queue of our own.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path

SCRIPT_BEGINS = "#!/bin/bash\n#SBATCH --job-name=scene2demo\n"
"""How an array job of this program begins."""

UNITS_A_PART = 20
"""Of 10 s each, the 3 to 5 s in which a part starts are 2 %."""

MOST_PARTS = 1000
"""As many tasks as an array may have by default (`MaxArraySize`)."""

LAST_S = 120
"""How long before its time is up a part is asked to end [s]."""

CLAIM_WAIT_S = 600.0
"""How long a part that is started again waits for its earlier run, whose machine may only be slow [s]."""

RESTARTS = "SLURM_RESTART_COUNT"
"""Variable of a part: how often it was started again; absent at first."""


@dataclass(frozen=True, slots=True)
class ArrayJob:
    """An array job.

    Attributes:
        command: The command line of the whole request, without `--shard` and `--workers`.
        file: The script's file; no control character is in its path.
        folder: Folder that the command runs in.
        logs: Folder of the parts' outputs; no control character, backslash or double quote is in its path.
        parts: Number of parts.
        workers: Processes of a part.
        hours: Most wall time of a part [h].
    """

    command: Sequence[str]
    file: Path
    folder: Path
    logs: Path
    parts: int
    workers: int
    hours: float = 4.0

    def script(self) -> str:
        """Return the script for `sbatch`."""
        minutes = max(ceil(60 * self.hours), ceil(2 * LAST_S / 60))
        file = shlex.quote(str(self.file.absolute()))
        return f"""{SCRIPT_BEGINS}#SBATCH --array=1-{self.parts}
#SBATCH --cpus-per-task={self.workers}
#SBATCH --time={minutes}
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --signal=B:TERM@{LAST_S}
#SBATCH --output="{str(self.logs.absolute()).replace("%", "%%")}/%A_%a.log"

# Submit it with `sbatch {self.file}`. Partition, account and memory may be added above, or given to sbatch.
cd {shlex.quote(str(self.folder.absolute()))} || exit 2
whole=({shlex.join(self.command)} --workers "${{SLURM_CPUS_PER_TASK:-{self.workers}}}")

follows=0
if [ "$SLURM_ARRAY_TASK_ID" = 1 ] && [ "${{SLURM_RESTART_COUNT:-0}}" = 0 ]; then
    # Whatever becomes of the parts, task 0 follows them, where they are.
    sbatch --array=0 --dependency="afterany:$SLURM_ARRAY_JOB_ID" \
        ${{SLURM_JOB_PARTITION:+--partition="$SLURM_JOB_PARTITION"}} \
        ${{SLURM_JOB_ACCOUNT:+--account="$SLURM_JOB_ACCOUNT"}} \
        ${{SLURM_MEM_PER_NODE:+--mem="$SLURM_MEM_PER_NODE"}} \
        {file} || follows=$?
    [ "$follows" = 0 ] || echo "scene2demo: sbatch refuses the last step: submit it by hand with --array=0" >&2
fi

share=()
[ "$SLURM_ARRAY_TASK_ID" = 0 ] || share=(--shard "$SLURM_ARRAY_TASK_ID/{self.parts}")
"${{whole[@]}}" "${{share[@]}}" &
part=$!
trap 'kill -TERM "$part" 2>/dev/null' TERM
wait "$part"
code=$?
# A signal ends the waiting, and not the part.
while kill -0 "$part" 2>/dev/null; do
    wait "$part"
    code=$?
done

case "$code" in
    # Done, whatever became of its units: a part that did nothing ends otherwise.
    0) exit "$follows" ;;
    # Out of time: Slurm starts the part again, and it goes on.
    130 | 143) scontrol requeue "${{SLURM_ARRAY_JOB_ID}}_$SLURM_ARRAY_TASK_ID" ;;
    # A fault of the machine or the program, bad input, a full disk; of task 0 also that nothing succeeded.
    *) exit "$code" ;;
esac
"""


def parts_for(units: int) -> int:
    """Return how many parts so many units make."""
    return max(1, min(ceil(units / UNITS_A_PART), MOST_PARTS))
