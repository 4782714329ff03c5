"""D1 and D3: the same objects, init and goal as the reference; strict mode's verdicts; printing and reading again."""

from __future__ import annotations

from typing import Any

import bddl
from benchmarks.conformance.context import ILLEGAL, Context, Measure, Result


def check_reading(context: Context) -> Result:
    """Compare what is read in compatible mode, and says what strict mode accepts."""
    unequal: list[str] = []
    rejected: dict[str, tuple[str, int, int]] = {}
    for name, text in context.corpus.items():
        theirs = context.peer.ask("read", text=text)
        ours = as_reference(bddl.parse(text, profile="behavior-compat"))
        if ours != without_marks(theirs):
            unequal.append(name)
        try:
            bddl.parse(text, profile="behavior")
        except bddl.BDDLError as error:
            first = error.diagnostics[0]
            rejected[name] = (first.code, first.line, first.column)
    total = len(context.corpus)
    return Result(
        (
            Measure(
                "equal objects, init and goal (compatible mode)",
                f"{total - len(unequal)} of {total}",
                goal=f"{total} of {total}",
                holds=not unequal,
            ),
            Measure(
                "accepted in strict mode",
                f"{total - len(rejected)} of {total}",
                reference=f"{total} of {total}",
                goal=f"{total - len(ILLEGAL)}, the two rejected at 31:9 and 22:6",
                holds=rejected == dict(ILLEGAL),
            ),
        ),
        {"unequal": unequal, "rejected": rejected},
    )


def check_round_trip(context: Context) -> Result:
    """Print what was read and reads it again, names of problems included."""
    failed = [
        name
        for name, text in context.corpus.items()
        if not _survives(bddl.parse(text, profile="behavior-compat"), "behavior-compat")
    ]
    strict = [
        name for name, text in context.legal.items() if not _survives(bddl.parse(text, profile="behavior"), "behavior")
    ]
    theirs: list[Any] = [
        context.peer.ask("round_trip", activity=name, text=text) for name, text in context.corpus.items()
    ]
    foreign = [
        name
        for name, text in context.corpus.items()
        if context.peer.ask("read", text=bddl.format(bddl.parse(text, profile="behavior-compat")))
        != context.peer.ask("read", text=text)
    ]
    total = len(context.corpus)
    return Result(
        (
            Measure(
                "printed here and read by the reference: as the file itself",
                f"{total - len(foreign)} of {total}",
                goal=f"{total} of {total}",
                holds=not foreign,
            ),
            Measure(
                "read = read(print(read)), names kept",
                f"{total - len(failed)} of {total}",
                f"{sum(found['equal'] for found in theirs)} of {total}, "
                f"{sum(found['name_kept'] for found in theirs)} names kept",
                f"{total} of {total}",
                not failed and not strict,
            ),
        ),
        {"failed": failed, "failed_strict": strict, "read_otherwise": foreign},
    )


def _survives(problem: bddl.Problem, profile: str) -> bool:
    """Decide whether printing and reading gives the same problem and the same text again."""
    printed = bddl.format(problem)
    again = bddl.parse(printed, profile=profile)
    return again == problem and again.name == problem.name and bddl.format(again) == printed


def as_reference(problem: bddl.Problem) -> dict[str, Any]:
    """Return a problem as the reference's lists, question marks left out."""
    objects: dict[str, list[str]] = {}
    for item in problem.objects:
        objects.setdefault(item.category, []).append(item.name)
    goal = problem.goal.parts if isinstance(problem.goal, bddl.And) else (problem.goal,)
    return {
        "objects": objects,
        "order": list(objects),
        "init": [as_list(literal) for literal in problem.init],
        "goal": [as_list(part) for part in goal],
    }


def as_list(formula: bddl.Formula) -> list[Any]:
    """Return a formula as nested lists of words, as the reference has it."""
    words = {bddl.Not: "not", bddl.And: "and", bddl.Or: "or", bddl.Imply: "imply", bddl.ForAll: "forall"}
    words |= {bddl.Exists: "exists", bddl.ForN: "forn", bddl.ForPairs: "forpairs", bddl.ForNPairs: "fornpairs"}
    if isinstance(formula, bddl.Atom):
        return list(formula.label)
    head: list[Any] = [words[type(formula)]]
    number, binders = getattr(formula, "number", None), getattr(formula, "binders", ())
    if number is not None:
        head.append([str(number)])
    head += [[binder.variable, "-", binder.category] for binder in binders]
    return head + [as_list(part) for part in formula.operands]


def without_marks(read: Any) -> dict[str, Any]:
    """Return what the reference read in the form of `as_reference`, question marks left out."""
    return {
        "objects": read.get("objects"),
        "order": list(read.get("objects", ())),
        "init": _stripped(read.get("init")),
        "goal": _stripped(read.get("goal")),
    }


def _stripped(item: Any) -> Any:
    if not isinstance(item, list):
        return str(item).strip("?")
    # What follows the first formula inside `not` is there after parsing, and dropped when the condition is compiled.
    kept = item[:2] if item[:1] == ["not"] else item
    return [_stripped(part) for part in kept]
