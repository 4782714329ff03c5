"""Hostile files through the command line: no crash, no hang, little memory, nothing outside, no escape sequences.

`python -m tests.executor.cli.test_attacks` prints what each costs.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.executor.cli.attacks import ATTACKS, Attack
from tests.executor.cli.conftest import environment

MOST_MB = 300.0
GUARD_S = 20
"""Seconds of one core, and in all, after which a command counts as hung; the aim is 2."""
_STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")
# A process begins with the memory of the one that it was copied from, so a small one stands between.
_APART = """
import json, os, resource, signal, sys
child = os.fork()
if not child:
    resource.setrlimit(resource.RLIMIT_CPU, (int(sys.argv[1]),) * 2)
    os.dup2(os.open(sys.argv[2], os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 1)
    os.dup2(1, 2)
    os.execv(sys.executable, [sys.executable, "-m", "executor.cli.app", *sys.argv[3:]])
signal.signal(signal.SIGALRM, lambda *_: os.kill(child, signal.SIGKILL))
signal.alarm(4 * int(sys.argv[1]))
_, status, used = os.wait4(child, 0)
print(json.dumps([os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime, used.ru_maxrss / 1024]))
"""


class Ended(NamedTuple):
    """How a command ended: exit code, seconds of one core, most memory, and what it printed."""

    code: int
    cpu_s: float
    peak_mb: float
    said: str


def ended(attack: Attack, base: Path) -> Ended:
    """Make an attack's files in a folder `here`, and runs its command there."""
    here, said = base / "here", base / "said"
    here.mkdir()
    attack.plant(here)
    done = subprocess.run(
        [sys.executable, "-S", "-c", _APART, str(GUARD_S), str(said), *map(str, attack.words)],
        cwd=here,
        env=environment() | {"SCENE2DEMO_CACHE": str(base / "cache")},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        check=True,
    )
    return Ended(*json.loads(done.stdout), said.read_bytes().decode("utf-8", "replace"))


@pytest.mark.parametrize(
    "attack",
    [pytest.param(attack, id=attack.name, marks=() if attack.fast else pytest.mark.slow) for attack in ATTACKS],
)
def test_it_does_no_harm(attack: Attack, tmp_path: Path) -> None:
    came = ended(attack, tmp_path)
    assert came.code in (0, 1, 2), came
    assert "Traceback" not in came.said and "unexpected error" not in came.said, came.said
    assert not _STEERING.search(came.said), came.said
    assert len(came.said) < 50_000, came.said[:2_000]
    assert came.peak_mb < MOST_MB, came
    assert {path.name for path in tmp_path.iterdir()} <= {"here", "said", "cache"}
    precious = tmp_path / "here" / "precious"
    assert not precious.exists() or precious.read_text() == "not yours"
    assert not (tmp_path / "here" / "outside").exists()


def test_there_are_enough_of_them() -> None:
    assert len(ATTACKS) >= 30 and 5 <= sum(attack.fast for attack in ATTACKS) <= 12
    assert len({attack.name for attack in ATTACKS}) == len(ATTACKS)


def main() -> None:
    """Print exit code, seconds of one core and memory of every attack, and the first words of what was said."""
    for attack in ATTACKS[int(sys.argv[1]) if len(sys.argv) > 1 else 0 :]:
        with tempfile.TemporaryDirectory() as base:
            came = ended(attack, Path(base))
        words = " ".join(came.said.split())[:90]
        sys.stdout.write(f"{attack.name:28} {came.code:4} {came.cpu_s:6.1f} s {came.peak_mb:6.0f} MB  {words}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
