"""Repeated decomposition: how many forms the noisy wordings of one task have, read as text and in canonical form.

    python -m benchmarks.stability [--variants 1000] [--seed 0]

The wordings come from a noise model (`benchmarks/noise.py`), not from a language model, so this shows what the
canonical form does with such differences, and nothing of how often a model makes them. Beside them stand wordings in
which one thing is wrong; those must never have the form of the task.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import oag
from benchmarks.noise import corrupted, variant
from benchmarks.noise_tasks import BaseTask, ten_tasks


@dataclass
class Counts:
    """What was counted of one task.

    Attributes:
        lengths: Number of subtasks -> number of wordings, as the paper's figure has it.
        texts: Different texts.
        sequences: Different sequences of (target, goal) as written.
        forms: Canonical form -> number of wordings.
        form_lengths: Number of subtasks of the canonical form -> number of wordings.
        broken: Wordings with a mistake, of which `merged` have the task's form and `refuted` have a refuted one.
    """

    name: str
    lengths: Counter[int] = field(default_factory=Counter)
    texts: set[str] = field(default_factory=set)
    sequences: set[str] = field(default_factory=set)
    forms: Counter[str] = field(default_factory=Counter)
    form_lengths: Counter[int] = field(default_factory=Counter)
    broken: Counter[str] = field(default_factory=Counter)
    merged: Counter[str] = field(default_factory=Counter)
    refuted: Counter[str] = field(default_factory=Counter)


def measure(base: BaseTask, variants: int, seed: int) -> Counts:
    """Count forms over so many wordings of a task, and as many with a mistake."""
    scene = oag.Scene.from_json(base.scene)
    plain = {"goal": f"(and {' '.join(base.goal)})", "scales": base.scales, "sub_tasks": base.subtasks}
    own = form_of(oag.canonical(oag.Task.from_json(plain, scene=scene)))
    counts = Counts(base.name)
    for number in range(seed, seed + variants):
        data = variant(base, number).task
        subtasks = written(data)
        counts.lengths[len(subtasks)] += 1
        counts.texts.add(json.dumps(data))
        counts.sequences.add(json.dumps([(s["target"], s["goal"]) for s in subtasks]))
        form = oag.canonical(oag.Task.from_json(data, scene=scene))
        counts.forms[form_of(form)] += 1
        counts.form_lengths[len(form.subtasks)] += 1
    if set(counts.forms) != {own}:
        print(f"{base.name}: {len(counts.forms)} forms, or another than that of the task itself")
    for number in range(seed, seed + variants):
        wording = corrupted(base, number)
        form = oag.canonical(oag.Task.from_json(wording.task, scene=scene))
        kind = wording.changes[0]
        counts.broken[kind] += 1
        counts.merged[kind] += form_of(form) == own
        counts.refuted[kind] += oag.compose(form).verify().verdict is oag.Verdict.REFUTED
    return counts


def form_of(form: oag.Task) -> str:
    """A canonical form as text, without the name of the task."""
    data = form.to_json()
    return json.dumps([data["goal"], data["sub_tasks"]])


def written(data: dict[str, Any]) -> list[dict[str, Any]]:
    """The subtasks of a wording, in order."""
    listed = data.get("sub_tasks")
    if listed is not None:
        return list(listed)
    numbered = sorted((int(key.rsplit("_", 1)[1]), key) for key in data if key.startswith("sub_task_"))
    return [data[key] for _, key in numbered]


def row(counts: Counts) -> str:
    """One line of the table."""
    spread = ", ".join(f"{length}: {number}" for length, number in sorted(counts.lengths.items()))
    kept = " or ".join(map(str, sorted(counts.form_lengths)))
    total, merged, refuted = (sum(c.values()) for c in (counts.broken, counts.merged, counts.refuted))
    return (
        f"| {counts.name} | {sum(counts.forms.values())} | {len(counts.texts)} | {len(counts.sequences)} | {spread} "
        f"| {len(counts.forms)} | {kept} | {merged} of {total} | {refuted} |"
    )


def main() -> None:
    """Print the table, and what became of each kind of mistake."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--variants", type=int, default=1000, help="wordings of each of the ten tasks")
    parser.add_argument("--seed", type=int, default=0, help="number of the first wording")
    options = parser.parse_args()
    print("| task | wordings | texts | sequences | subtasks: wordings | forms | subtasks | merged | refuted |")
    print("|---|---|---|---|---|---|---|---|---|")
    kinds: dict[str, list[int]] = {}
    for base in ten_tasks():
        counts = measure(base, options.variants, options.seed)
        print(row(counts), flush=True)
        for kind, total in counts.broken.items():
            sums = kinds.setdefault(kind, [0, 0, 0])
            for index, number in enumerate((total, counts.merged[kind], counts.refuted[kind])):
                sums[index] += number
    for kind, (total, merged, refuted) in sorted(kinds.items()):
        print(f"{kind}: {total} wordings, {merged} with the form of the task, {refuted} refuted")


if __name__ == "__main__":
    main()
