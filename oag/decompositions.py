"""Stability of a decomposition: one query decomposed again and again, rephrased and in changed scenes.

    found = oag.stability(my_planner, "put the apple into the drawer", scene, n=20)
    print(found)           # forms with counts, verdicts, one example and the edits from the first form

Whatever takes a query and a scene can be asked. Names are taken back before forms are compared, so that a form is one
up to renaming; forms are canonical, so that another wording of one decomposition is no other form.

Source: the paper's repeated decomposition study, which counts subtasks; docs/semantics.md, Canonical form.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from random import Random

from bddl.terminal import pluralize
from oag.edit_script import EditScript, edit_script
from oag.graph import compose
from oag.measurements import clopper_pearson
from oag.model.codec import brief, expected, shown
from oag.model.diagnostics import TaskError
from oag.model.scene import Scene
from oag.normal_form import canonical, digest_of_form, resolver, with_scene_names
from oag.perturbations import PERTURBATIONS, Perturbation, Setting, checked, perturbed
from oag.phrasing import rephrasings
from oag.picture import bars
from oag.task_definition import Task, required_scene
from oag.verify.verify import Verdict

Decompose = Callable[[str, Scene], object]
_ARGUMENT = "(argument)"


@dataclass(frozen=True, slots=True)
class Run:
    """One decomposition.

    Attributes:
        setting: The query and the scene that were asked about.
        outcome: Digest of its form; of a refusal or an error its kind, such as `QueryError ambiguous-object`.
        task: The canonical form, under the names of the given scene; None where there was no task.
        verdict: Of the task; None where there was none.
        message: The refusal or the error in words; empty for a task.
    """

    setting: Setting
    outcome: str
    task: Task | None = None
    verdict: Verdict | None = None
    message: str = ""

    def __repr__(self) -> str:
        what = self.outcome[:12] if self.task is not None else self.outcome
        return brief(f"<Run {what} of {self.setting!r}>")


@dataclass(frozen=True, slots=True)
class DecompositionForm:
    """One outcome, with the runs that had it.

    Attributes:
        outcome: Digest of the form up to renaming, or the kind of a refusal or an error.
        interval: Exact 95 % confidence interval of its share, as if the runs were independent.
        verdicts: Verdict -> number of runs; empty for what is no task.
        subtasks: How many subtasks it has; None for what is no task.
        edits: The changes from the first run's form to this one; None for that form itself, and for what is no task.
    """

    outcome: str
    runs: tuple[Run, ...]
    interval: tuple[float, float]
    verdicts: Mapping[str, int]
    subtasks: int | None
    edits: EditScript | None

    @property
    def count(self) -> int:
        """How many runs had it."""
        return len(self.runs)

    @property
    def example(self) -> Run:
        """The first run that had it."""
        return self.runs[0]

    @property
    def name(self) -> str:
        """The first characters of the digest, or the kind of a refusal or an error."""
        return self.outcome if self.subtasks is None else self.outcome[:12]

    def __repr__(self) -> str:
        return brief(f"<DecompositionForm {self.name}: {pluralize(self.count, 'run')}, {self._verdicts()}>")

    def _verdicts(self) -> str:
        return ", ".join(f"{count} {verdict}" for verdict, count in self.verdicts.items()) or "no task"

    def to_json(self) -> dict[str, object]:
        """Return the form as JSON values."""
        example = self.example
        return {
            "outcome": self.outcome,
            "count": self.count,
            "interval": list(self.interval),
            "verdicts": dict(self.verdicts),
            "subtasks": self.subtasks,
            "edits": None if self.edits is None else [edit.to_json() for edit in self.edits.edits],
            "edits_in_words": None if self.edits is None else list(self.edits.words),
            "example": {
                "query": example.setting.query,
                "changes": list(example.setting.kinds),
                "task": None if example.task is None else example.task.to_json(),
                "message": example.message,
            },
        }

    def __str__(self) -> str:
        """Return the form with its example as lines for a person."""
        low, high = self.interval
        size = "" if self.subtasks is None else f", {pluralize(self.subtasks, 'subtask')}"
        lines = [f"{self.count:4}  {self.name}{size}: {self._verdicts()}, {low:.0%} to {high:.0%} of runs"]
        changes = ", ".join(self.example.setting.kinds) or "as given"
        lines.append(f"      such as {self.example.setting.query!r} ({changes})")
        if self.example.message:
            lines += [f"      {line}" for line in self.example.message.splitlines()[:3]]
        if self.edits is not None:
            lines += [f"      edit  {words}" for words in self.edits.words or ("nothing",)]
        elif self.example.task is not None:
            lines.append(
                f"      {'; '.join(s.name.replace('_', ' ') for s in self.example.task.subtasks) or 'nothing'}"
            )
        return "\n".join(lines)


@dataclass(frozen=True, slots=True)
class Stability:
    """What repeated decompositions of one query came to; true when all runs had one form.

    Attributes:
        query: The query as it was given.
        runs: All runs, in order; the first is of the query and the scene as they were given.
        forms: The outcomes, the most frequent first.
    """

    query: str
    runs: tuple[Run, ...]
    forms: tuple[DecompositionForm, ...] = field(repr=False)

    def __bool__(self) -> bool:
        return len(self.forms) == 1

    @property
    def agreeing(self) -> tuple[int, int]:
        """How many of the later runs have the first one's form, and how many later runs there are."""
        return sum(run.outcome == self.runs[0].outcome for run in self.runs[1:]), len(self.runs) - 1

    @property
    def interval(self) -> tuple[float, float]:
        """Exact 95 % confidence interval of the share of later runs with the first form; 0 to 1 without later runs."""
        agreeing, count = self.agreeing
        return clopper_pearson(agreeing, count) if count else (0.0, 1.0)

    @property
    def by_change(self) -> dict[str, tuple[int, int]]:
        """Of runs with one kind of change alone: how many have the first form, and how many there are."""
        found: dict[str, tuple[int, int]] = {}
        for run in self.runs[1:]:
            name = run.setting.kinds[0] if len(run.setting.kinds) == 1 else "all" if run.setting.kinds else "none"
            same, count = found.get(name, (0, 0))
            found[name] = same + (run.outcome == self.runs[0].outcome), count + 1
        return found

    @property
    def lengths(self) -> dict[int, int]:
        """Number of subtasks -> number of runs, as the paper's figure has it."""
        counted = Counter(len(run.task.subtasks) for run in self.runs if run.task is not None)
        return dict(sorted(counted.items()))

    def __repr__(self) -> str:
        return brief(f"<Stability of {self.query[:80]!r}: {pluralize(len(self.forms), 'form')} in {self._counted()}>")

    def _counted(self) -> str:
        return pluralize(len(self.runs), "run")

    def __str__(self) -> str:
        """Return the forms for a person."""
        agreeing, count = self.agreeing
        low, high = self.interval
        lines = [
            f"{'STABLE' if self else 'UNSTABLE'}  {self.query!r}: "
            f"{pluralize(len(self.forms), 'form')} in {self._counted()}"
        ]
        if count:
            lines.append(f"  {agreeing} of {count} later runs have the first form (95 %: {low:.1%} to {high:.1%})")
        lines += [f"  {name:12} {same} of {of}" for name, (same, of) in self.by_change.items()]
        return "\n".join([*lines, *map(str, self.forms)])

    def to_json(self) -> dict[str, object]:
        """Return the forms with their counts as JSON values."""
        agreeing, count = self.agreeing
        return {
            "query": self.query,
            "stable": bool(self),
            "runs": len(self.runs),
            "agreeing": agreeing,
            "later_runs": count,
            "interval": list(self.interval),
            "by_change": {name: list(counts) for name, counts in self.by_change.items()},
            "subtasks": {str(length): runs for length, runs in self.lengths.items()},
            "forms": [form.to_json() for form in self.forms],
        }

    def to_svg(self) -> str:
        """Return a picture as a file: a bar for each number of subtasks, a part for each form, proved ones green."""
        rows: dict[str, list[tuple[int, str, str]]] = {}
        for form in self.forms:
            length = "none" if form.subtasks is None else str(form.subtasks)
            colour = max(form.verdicts, key=lambda verdict: form.verdicts[verdict], default="none")
            rows.setdefault(length, []).append((form.count, colour, f"{form.name}: {pluralize(form.count, 'run')}"))
        ordered = sorted(rows.items(), key=lambda row: (row[0] == "none", row[0].zfill(6)))
        return bars(self.query, "subtasks", "runs", ordered)

    def _repr_html_(self) -> str:
        """Return the picture for a notebook."""
        return f"<div>{self.to_svg()}</div>"


def stability(
    decompose: Decompose,
    query: str,
    scene: Scene,
    n: int = 20,
    perturb: Iterable[str] = PERTURBATIONS,
    *,
    seed: int = 0,
    flows: bool = False,
    wordings: Sequence[str] | None = None,
    refusals: tuple[type[Exception], ...] = (Exception,),
    listen: Callable[[int, int], None] | None = None,
) -> Stability:
    """Decompose a query again and again, rephrased and in changed scenes, and count the forms of the results.

    The first run is of the query and the scene as they are. Later ones change one thing each, in turn, then all
    together; without changes they repeat the first.

    Args:
        decompose: Takes a query and a scene, and returns a `Task`, its file's mapping, or something with a `task`,
            such as a proposal.
        query: The request.
        scene: The scene.
        n: How many runs.
        perturb: What is changed: "paraphrase", "rename", "order", "distractors", "mirror".
        seed: Decides all changes.
        flows: Whether forms with other flows are other forms; by default the subtasks alone count.
        wordings: Other sentences for the query; by default its verb and courtesies are exchanged.
        refusals: Exceptions that are outcomes when a later run raises them; all others, and those of the first run, are
            raised.
        listen: Called after each run with the number of runs done, and of all.

    Raises:
        TaskError: An argument cannot be used, or the first result is no task.

    Example:
        >>> import oag
        >>> scene = oag.scene({"drawer_0": "drawer"}, closed="all")
        >>> opened = lambda query, scene: oag.task(scene, steps=[oag.open(next(iter(scene.objects)))])
        >>> oag.stability(opened, "open the drawer", scene, n=5, perturb=["rename", "paraphrase"])
        <Stability of 'open the drawer': 1 form in 5 runs>
    """
    required_scene(scene)
    _check_arguments(decompose, n)
    kinds = checked(perturb)
    cycle: list[tuple[Perturbation, ...]] = [(kind,) for kind in kinds] + ([kinds] if len(kinds) > 1 else [])
    texts = tuple(rephrasings(query)) if wordings is None else tuple(wordings)
    runs: list[Run] = []
    for number in range(n):
        changes = cycle[(number - 1) % len(cycle)] if number and cycle else ()
        setting = perturbed(query, scene, changes, Random(f"{seed} {number}"), texts)
        runs.append(_run(decompose, setting, refusals if number else (), flows=flows))
        if listen is not None:
            listen(number + 1, n)
    return Stability(query, tuple(runs), _forms(runs, flows=flows))


def _check_arguments(decompose: object, n: object) -> None:
    if not callable(decompose):
        problem = f"expected a function of a query and a scene, got {shown(decompose)}"
        raise TaskError(problem, source=_ARGUMENT, place="decompose")
    if not isinstance(n, int) or n < 1:
        raise TaskError(expected("a number of runs from 1 up", n), source=_ARGUMENT, place="n")


def _run(decompose: Decompose, setting: Setting, refusals: tuple[type[Exception], ...], *, flows: bool) -> Run:
    try:
        made = _task_of(decompose(setting.query, setting.scene), setting.scene)
    except refusals as problem:
        code = getattr(problem, "code", "")
        kind = f"{type(problem).__name__} {code}" if isinstance(code, str) and code else type(problem).__name__
        return Run(setting, kind, message=str(problem))
    named = with_scene_names(made, resolver(setting.scene))
    back = with_scene_names(named, lambda name: setting.original.get(name, name))
    form = canonical(back, setting.judged)
    return Run(setting, digest_of_form(form, flows=flows), form, compose(back, setting.judged).verify().verdict)


def _task_of(made: object, scene: Scene) -> Task:
    """Return the task of a result: itself, the one that it carries, or the one that its JSON describes."""
    task = getattr(made, "task", made)
    if isinstance(task, Task):
        return task
    if isinstance(task, Mapping | str | os.PathLike):
        return Task.from_json(task, scene=scene)
    problem = f"expected a Task, its mapping, or something with a task, got {shown(made)}"
    raise TaskError(problem, source=_ARGUMENT, place="decompose")


def _forms(runs: Sequence[Run], *, flows: bool) -> tuple[DecompositionForm, ...]:
    grouped: dict[str, list[Run]] = {}
    for run in runs:
        grouped.setdefault(run.outcome, []).append(run)
    ordered = sorted(grouped.items(), key=lambda group: -len(group[1]))
    return tuple(map(partial(_form, runs, flows=flows), *zip(*ordered, strict=True)))


def _form(runs: Sequence[Run], outcome: str, group: Sequence[Run], *, flows: bool) -> DecompositionForm:
    example, reference = group[0].task, runs[0].task
    script = None
    if example is not None and reference is not None and outcome != runs[0].outcome:
        script = edit_script(reference, example, flows=flows)
    verdicts = Counter(run.verdict.value for run in group if run.verdict is not None)
    return DecompositionForm(
        outcome,
        tuple(group),
        clopper_pearson(len(group), len(runs)),
        dict(verdicts),
        None if example is None else len(example.subtasks),
        script,
    )
