"""What this version does, as data, through its public doors: what `make golden` freezes and compares.

Each part returns items by name. `exact` values are compared where machine and libraries are those that froze them;
`rough` values, which no rounding of floating-point numbers changes, are compared everywhere.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import random
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from itertools import islice
from pathlib import Path
from typing import Any

import bddl
import llm
import oag
from benchmarks.conformance.fuzz import LIBERO_TEXT, PROFILES, fuzzed
from benchmarks.conformance.mutants import mutants as text_mutants
from oag.model.diagnostics import CODES
from tests.bddl.activity import ACTIVITY
from tests.llm.scripted_modules import QUERIES, TASKS, Script, Wrong, right_answers, scene_of
from tests.oag.mutants import mutants as plan_mutants
from tests.oag.other_tasks import OTHERS
from tests.oag.paper import INVALID, NAMES, invalid, scene, task_json

ROOT = Path(__file__).resolve().parents[2]
LIBRARIES = ("numpy", "scipy", "sapien", "trimesh", "torch", "pyarrow", "h5py", "av", "opencv-python", "embreex")
# Longer than any part takes on two busy cores.
LONGEST_S = 3000


@dataclass(frozen=True)
class Item:
    """One outcome.

    Attributes:
        rough: What is the same on every machine.
        exact: What is the same on one kind of machine, or None where there is no more.
    """

    rough: Any
    exact: Any = None


Items = dict[str, Item]


def digest(value: object) -> str:
    """Return 16 hexadecimal digits of a value that JSON can hold."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:16]


def machine() -> dict[str, str]:
    """Return what floating-point results may depend on: the processor and the libraries that compute."""
    cpu = next(
        (line.partition(":")[2].strip() for line in _lines("/proc/cpuinfo") if line.startswith("model name")),
        platform.processor(),
    )
    versions = {name: _version(name) for name in LIBRARIES}
    return {"python": platform.python_version(), "cpu": cpu, **versions}


def _lines(path: str) -> list[str]:
    try:
        return Path(path).read_text(encoding="utf-8").splitlines()
    except OSError:
        return []


def _version(library: str) -> str:
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return "missing"


# ---------------------------------------------------------------- the language and the proofs


def report_of(report: oag.Report) -> dict[str, Any]:
    """Return what `verify` decided, each part by its digest beside what a reader compares first."""
    data = report.to_json()
    certificate = data["certificate"]
    return {
        "verdict": data["verdict"],
        "codes": [finding["code"] for finding in data["diagnostics"]],  # type: ignore[union-attr,call-overload]
        "diagnostics": digest(data["diagnostics"]),
        "regressed": digest(data["regressed_goals"]),
        "fixes": digest(data["fixes"]),
        "counterexample": digest(data["counterexample"]),
        "certificate": digest(certificate),
        "recheck": certificate is not None and bool(oag.recheck(certificate).ok),
    }


def plans() -> dict[str, tuple[oag.Scene, dict[str, Any]]]:
    """Return the right plans that the formal core is tested with, by name."""
    found = {name: (scene(name), task_json(name)) for name in NAMES}
    return found | {name: (oag.Scene.from_json(world), data) for name, (world, data) in OTHERS.items()}


def verdicts() -> Items:
    """Return the decision on every task fixture, right and wrong, and the canonical form of the right ones."""
    found: Items = {}
    for name, (world, data) in plans().items():
        task = oag.Task.from_json(data, scene=world)
        found[name] = Item(report_of(oag.compose(task).verify()) | {"canonical": oag.canonical_digest(task, world)})
    return found | {f"invalid/{name}": Item(report_of(invalid(name))) for name in INVALID}


def mutants(every: int) -> Items:
    """Return verdict, codes and fixes of one of `every` single mistakes in each plan, a digest a kind."""
    found: Items = {}
    for name, (world, data) in plans().items():
        kinds: dict[str, list[Any]] = {}
        for number, mutant in enumerate(plan_mutants(data, tuple(world.objects))):
            if number % every == 0:
                report = oag.compose(mutant.data, world).verify()
                codes = [finding.code for finding in report.diagnostics]
                kinds.setdefault(mutant.kind, []).append([report.verdict.value, codes, list(map(str, report.fixes))])
        found |= {
            f"{name}/{kind}": Item({"count": len(entries), "refuted": sum(e[0] == "REFUTED" for e in entries),
                                    "digest": digest(entries)})
            for kind, entries in kinds.items()
        }  # fmt: skip
    return found


def language() -> Items:
    """Return what `bddl.check` finds in an activity, its mutants and random texts, by profile."""
    texts = {"activity": [ACTIVITY], "libero": [LIBERO_TEXT]}
    texts["mutants"] = [mutant.text for seed in range(4) for mutant in text_mutants("rinse", ACTIVITY, seed)]
    found: Items = {}
    for profile in PROFILES:
        random_texts = list(islice(fuzzed([ACTIVITY, LIBERO_TEXT], random.Random(profile)), 60))
        for name, group in {**texts, "random": random_texts}.items():
            codes = [[str(finding) for finding in bddl.check(text, profile=profile)] for text in group]
            clean = sum(not each for each in codes)
            found[f"{profile}/{name}"] = Item({"texts": len(group), "clean": clean, "digest": digest(codes)})
    return found


def requests() -> Items:
    """Return the digests of what a scripted model is asked: right answers, and a wrong one to each module."""
    found: Items = {}
    for name in TASKS:
        right = right_answers(name)
        scripts = {"right": Script(right)}
        scripts |= {f"module {module} wrong": Script(right, {module: [Wrong("no JSON", "")]}) for module in right}
        for case, script in scripts.items():
            proposal = llm.ModelProposer(script, name="script").propose(QUERIES[name], scene_of(name))
            asked = [
                [[message.role, list(map(str, message.parts))] for message in each.messages] for each in script.asked
            ]
            verdict = oag.compose(proposal.task).verify().verdict.value
            found[f"{name}/{case}"] = Item({"rounds": len(asked), "verdict": verdict, "digest": digest(asked)})
    return found


# ---------------------------------------------------------------- the command line


def command(
    *words: object, folder: Path | None = None, most_s: float = LONGEST_S, program: str = "executor"
) -> subprocess.CompletedProcess[str]:
    """Return what a command line printed and its exit code, in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb"}
    return subprocess.run(
        [sys.executable, "-m", program, *map(str, words)],
        capture_output=True, text=True, cwd=folder or ROOT, env=environment, timeout=most_s, check=False,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip


def commands() -> list[tuple[str, ...]]:
    """Return every command as typed, those of two words too."""
    (listed,) = re.findall(r"\{([a-z, -]+)\}", command("--help").stdout)[:1]
    found: list[tuple[str, ...]] = []
    for name in listed.split(","):
        words = tuple(name.split(" "))
        below = re.match(r"usage: scene2demo \S+ \[-h\] \{([a-z,-]+)\}", command(*words, "--help").stdout)
        found += [(*words, each) for each in below[1].split(",")] if below else [words]
    return found


def helps() -> Items:
    """Return the options of every command, and a digest of its help."""
    found: Items = {}
    for words in commands():
        done = command(*words, "--help")
        options = re.findall(r"(?m)^│\s(--[a-z0-9-]+)", done.stdout)
        found[" ".join(words)] = Item({"code": done.returncode, "options": options}, digest(done.stdout))
    return found


def answers(folder: Path) -> Items:
    """Return exit code and JSON keys of commands that answer at once, right and wrong."""
    data = ROOT / "tests" / "data"
    text = folder / "activity.bddl"
    text.write_text(ACTIVITY, encoding="utf-8")
    task, world, wrong = data / "T1.json", data / "T1_scene.json", data / "invalid" / "dropped_open.json"
    cases: dict[str, Sequence[object]] = {
        "verify proved": ("verify", task),
        "verify refuted": ("verify", wrong, "--scene", world),
        "verify malformed": ("verify", data / "invalid" / "wrong_arity.json", "--scene", world),
        "verify missing file": ("verify", "no/such/file.json"),
        "plan": ("plan", "put the glass into the refrigerator", "--scene", "kitchen_t1"),
        "plan not understood": ("plan", "sing a song", "--scene", "kitchen_t1"),
        "plan unknown scene": ("plan", "open the refrigerator", "--scene", "nowhere"),
        "graph": ("graph", task),
        "scenes": ("scenes",),
        "scenes of a file": ("scenes", world),
        "assets": ("assets",),
        "bddl check": ("bddl", "check", text),
        "doctor": ("doctor",),
        "usage": ("verify",),
    }
    found: Items = {}
    for name, words in cases.items():
        done = command(*words, "--json")
        keys = sorted(set(_keys(json.loads(done.stdout)))) if done.stdout.strip() else []
        found[name] = Item({"code": done.returncode, "keys": keys})
    return found


def _keys(value: object, path: str = "") -> Iterator[str]:
    """Yield the paths of keys; entries of lists, and of objects whose keys are ids, count as one."""
    if isinstance(value, Mapping):
        for key, entry in value.items():
            part = "ID" if re.search(r"_\d+$|/|\d", key) else key
            yield f"{path}{part}"
            yield from _keys(entry, f"{path}{part}.")
    elif isinstance(value, list):
        for entry in value:
            yield from _keys(entry, f"{path[:-1]}[].")


def codes() -> Items:
    """Return the diagnostic codes of plans and texts with their meanings."""
    found = {f"oag {code}": Item(info.meaning) for code, info in CODES.items()}
    return found | {f"bddl {code}": Item(str(meaning)) for code, meaning in bddl.MEANINGS.items()}


# ---------------------------------------------------------------- physics, photographs, data, policies


def benched(folder: Path, families: Sequence[str], episodes: int, *more: str) -> Items:
    """Return the outcome of every unit of a benchmark."""
    done = command("bench", *families, "--episodes", episodes, "--seed", 94100, "--out", folder, "--json", *more)
    assert done.returncode in (0, 1), done.stderr
    return units_of(folder)


def units_of(folder: Path) -> Items:
    """Return the outcome of every unit in a benchmark's folder."""
    found: Items = {}
    for path in sorted((folder / "units").glob("*.json")):
        unit = json.loads(path.read_text(encoding="utf-8"))
        failure = unit.get("failure") or {}
        rough = {
            "ended": unit["ended"],
            "failure": failure.get("kind"),
            "subtasks": [part["succeeded"] for part in unit.get("subtasks", [])],
            "scene": unit["scene"],
        }
        exact = {key: unit.get(key) for key in ("scene_hash", "task_hash", "state_hash")}
        found[unit["name"]] = Item(rough, exact)
    return found


FAULTS = (
    "pose:glass_0,size_m=0.02",
    "scale:glass_0,factor=1.1",
    "door:refrigerator_0,fraction=0.5",
    "navigation:size_m=0.05",
    "grip:force_n=0.5",
)


def faults(folder: Path) -> Items:
    """Return what self-evolution makes of each kind of fault in the paper's first task."""
    planned = command("run", QUERIES["T1"], "--scene", "kitchen_t1", "--no-video", "--out", folder / "planned")
    assert planned.returncode == 0, planned.stderr
    found: Items = {}
    for fault in FAULTS:
        words = ("evolve", folder / "planned" / "task.json", "--scene", "kitchen_t1", "--fault", fault, "--json")
        done = command(*words, "--seed", 94200)
        (episode,) = json.loads(done.stdout)["episodes"]
        keys = ("succeeded", "succeeded_at_once", "revisions")
        found[fault] = Item({key: episode.get(key) for key in keys}, episode.get("state_hash"))
    return found


def photographs(folder: Path, rooms: int, kitchens: int) -> Items:
    """Return what is reconstructed of drawn rooms with noisy depth and spoilt boxes (track B)."""
    words = ("--rooms", rooms, "--kitchens", kitchens, "--seed", 94300, "--out", folder)
    done = command(*words, program="benchmarks.drawn_rooms")
    assert done.returncode == 0, done.stderr
    found: Items = {}
    for path in sorted(folder.rglob("*.json")):
        room = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(room, dict) and "room" in room:
            things = [thing["thing"] for thing in room["things"]]
            found[path.stem] = Item({"things": things, "refused": bool(room["refused"])}, digest(_without_times(room)))
    return found


def _without_times(value: Any) -> Any:
    """Return JSON values without what a clock measured, or the program's version."""
    if isinstance(value, Mapping):
        kept = {key: entry for key, entry in value.items() if not re.search(r"(wall|cpu|took)_s$|^version$|^id$", key)}
        return {key: _without_times(entry) for key, entry in kept.items()}
    return [_without_times(entry) for entry in value] if isinstance(value, list) else value


FORMATS = ("lerobot", "lerobot-v2.1", "robomimic", "zarr")


def exports(folder: Path) -> Items:
    """Return the digests of one store's episodes, and of every file that it is folded into."""
    store = folder / "store"
    words = ("generate", "T5", "T6", "--episodes", 1, "--seed", 94400, "--views", "head", "--size", 64, 48)
    made = command(*words, "--out", store, "--json")
    assert made.returncode == 0, made.stderr
    found: Items = {}
    for kind in FORMATS:
        done = command("dataset", "export", store, "--format", kind, "--out", folder / kind)
        assert done.returncode == 0, done.stderr
        for path in sorted(path for path in (folder / kind).rglob("*") if path.is_file()):
            name = f"{kind}/{path.relative_to(folder / kind).as_posix()}"
            found[name] = Item("present", hashlib.sha256(path.read_bytes()).hexdigest()[:16])
    return found


def weights(folder: Path) -> Items:
    """Return the digest of a small policy's weights after 200 steps."""
    store, settings = folder / "store", folder / "small.toml"
    kitchen = ROOT / "examples" / "policies" / "kitchen.json"
    words = ("generate", "pick up the glass", "--scene", kitchen, "--episodes", 2, "--seed", 94500, "--vary", "target")
    made = command(*words, "--out", store, "--json")
    assert made.returncode == 0, made.stderr
    settings.write_text(
        '[sees]\nkind = "state"\nphase = true\n[acts]\nkind = "joint_target"\nchunk = 8\nexecute = 4\n'
        '[network]\nkind = "mlp"\nwidth = 32\nlayers = 2\n[training]\nsteps = 200\nbatch = 16\naverage = 0.9\n',
        encoding="utf-8",
    )
    done = command("train", settings, "--data", store, "--out", folder / "policy", "--json")
    assert done.returncode == 0, done.stderr
    files = sorted((folder / "policy").rglob("*.safetensors"))
    assert files
    found = {path.name: Item("present", hashlib.sha256(path.read_bytes()).hexdigest()[:16]) for path in files}
    done = command("evaluate", folder / "policy", "--data", store, "--episodes", 2, "--seed", 94600, "--json")
    assert done.returncode in (0, 1), done.stderr
    # Where the files lie is no outcome.
    text = done.stdout.replace(str(folder), "FOLDER").replace(str(ROOT), "ROOT")
    evaluation = _without_times(json.loads(text))
    return found | {"evaluation": Item(sorted(set(_keys(evaluation))), digest(evaluation))}


BASELINES = ("unchecked", "checked", "repaired", "constraint-pose", "sampled-grasp", "one-demonstration")


def baselines(folder: Path) -> Items:
    """Return what each baseline makes of a kitchen."""
    found: Items = {}
    for baseline in BASELINES:
        words = (baseline, "T1", "--episodes", 1, "--seed", 94100, "--out", folder / baseline)
        done = command(*words, program="benchmarks.baselines")
        assert done.returncode == 0, done.stderr
        found |= {f"{baseline}/{name}": item for name, item in units_of(folder / baseline).items()}
    return found


# ---------------------------------------------------------------- all of it

LONG = ("T1", "T2", "T3", "T4")
# Parts that `make test` runs: ten seconds of a core.
QUICK: dict[str, Callable[[Path], Items]] = {
    "verdicts": lambda folder: verdicts(),
    "language": lambda folder: language(),
    "requests": lambda folder: requests(),
    "codes": lambda folder: codes(),
}
# The others, which `make golden` runs as well.
WHOLE: dict[str, Callable[[Path], Items]] = {
    "helps": lambda folder: helps(),
    "answers": answers,
    "mutants": lambda folder: mutants(1),
    "physics": lambda folder: benched(folder, (*LONG, "T5", "T6"), 10),
    "paper_flows": lambda folder: benched(folder, LONG, 5, "--flows", "paper", "--evolve"),
    "faults": faults,
    "photographs": lambda folder: photographs(folder, 6, 2),
    "baselines": baselines,
    "exports": exports,
    "weights": weights,
}
