"""Progress and options of goals: coherent with truth where the reference's reward is not, and never exploding.

For each activity of the reference's corpus, states of its goal's atoms are drawn as for truth: of all densities, and
some in which the goal was made true; to these come completions of its own options, and states known in part. Progress
must be 1 exactly where the goal is true. Each option must imply the goal, which z3 decides.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import islice, pairwise
from pathlib import Path
from typing import TypeVar

import bddl
from bddl.smt import Script, Solver, solve
from benchmarks.compiled_goals import CompiledGoal, compile_goal
from benchmarks.conformance.context import Context, Measure, Result
from benchmarks.conformance.goal_peer import GoalPeer
from benchmarks.conformance.goal_states import draw

SCRIPT = Path(__file__).with_name("reference_rewards.py")
STATES = 64
OPTIONS = 20
# An activity is timed so often, and the best counts.
TIMES = 5
# What was promised, in seconds.
MOST_TOGETHER, MOST_ALONE = 2.0, 1.0

_Answer = TypeVar("_Answer")


@dataclass
class _Tally:
    """What was counted over all activities."""

    states: int = 0
    true: int = 0
    incoherent: list[str] = field(default_factory=list)
    options: dict[str, int] = field(default_factory=dict)
    unsatisfiable: list[str] = field(default_factory=list)
    unsound: list[str] = field(default_factory=list)
    disordered: list[str] = field(default_factory=list)
    cut_short: list[str] = field(default_factory=list)
    option_seconds: dict[str, float] = field(default_factory=dict)
    start_seconds: dict[str, float] = field(default_factory=dict)
    compile_seconds: dict[str, float] = field(default_factory=dict)
    reward_seconds: float = 0.0
    timed_states: int = 0
    reference_seconds: float = 0.0
    reference_ground_seconds: dict[str, float] = field(default_factory=dict)
    reference_errors: dict[str, str] = field(default_factory=dict)
    reference_options: dict[str, int] = field(default_factory=dict)
    solved_unrewarded: dict[str, float] = field(default_factory=dict)
    unsolved_rewarded: list[str] = field(default_factory=list)


def _smt_text(ground: bddl.Ground) -> str:
    """Return text that is satisfiable exactly when the formula is; its atoms are a0, a1 and so on."""
    names = [f"a{index}" for index in range(len(ground.atoms))]
    script = Script()
    script.declare(*names)
    script.require(script.term(ground.root, names.__getitem__))
    return script.text()


def check_coherence(context: Context) -> Result:
    """Compare progress with truth, and the reference's reward with truth, on the same states."""
    names = sorted(context.corpus)[:: 10 if context.quick else 1]
    tally = _Tally()
    with GoalPeer(context.interpreter, SCRIPT) as peer:
        for name in names:
            problem = bddl.parse(context.corpus[name], profile="behavior-compat")
            _try(name, problem, peer, random.Random(f"{context.seed} {name}"), tally)
    return Result(tuple(_measures(tally, len(names))), {**vars(tally)})


def _try(name: str, problem: bddl.Problem, peer: GoalPeer, source: random.Random, tally: _Tally) -> None:
    objects = {thing.name: thing.category for thing in problem.objects}
    seconds, compiled = _timed(lambda: bddl.GoalProgress(problem.goal, objects))
    tally.compile_seconds[name] = seconds
    goal = compile_goal(problem.goal, objects)
    found = _options(name, problem, objects, tally)
    states = list(draw(goal, bddl.ground(problem.goal, objects).root, source, STATES))
    states += list(_completions(goal, found, source))
    if not _coherent(goal, compiled, objects, states, source):
        tally.incoherent.append(name)
    _reference(name, problem, peer, states, compiled, tally)
    tally.states += len(states)
    tally.true += sum(map(goal.evaluate, states))


def _coherent(
    goal: CompiledGoal,
    progress: bddl.GoalProgress,
    objects: dict[str, str],
    states: list[int],
    source: random.Random,
) -> bool:
    """Whether progress is 1 exactly where the goal is true: in the states, and in parts of them."""
    for state in states:
        if (progress.packed(state) == 1.0) != goal.evaluate(state):
            return False
        ignorance = source.choice((0.02, 0.1, 0.5))
        known = {
            atom: bool(state >> index & 1) for index, atom in enumerate(goal.atoms) if source.random() >= ignorance
        }
        decided = [bddl.evaluate(part, known, objects) for part in goal.conditions]
        if (progress(known) == 1.0) != all(value is True for value in decided):
            return False
    return True


def _completions(goal: CompiledGoal, found: list[bddl.Option], source: random.Random) -> Iterator[int]:
    """Yield, for each option, a state in which it holds and everything else is random."""
    places = {atom: index for index, atom in enumerate(goal.atoms)}
    for option in found:
        values = [source.random() < 0.5 for _ in goal.atoms]
        for literal in option:
            values[places[literal.atom]] = literal.value
        yield goal.pack(values)


def _options(name: str, problem: bddl.Problem, objects: dict[str, str], tally: _Tally) -> list[bddl.Option]:
    """Return the first options of a goal, after checking them: each implies it, none contains another, in order."""
    true = {atom for atom in problem.init if isinstance(atom, bddl.Atom)}
    seconds, found = _timed(lambda: list(islice(bddl.options(problem.goal, objects), OPTIONS)))
    start_seconds, from_start = _timed(
        lambda: list(islice(bddl.options(problem.goal, objects, lambda atom: atom in true), OPTIONS))
    )
    tally.option_seconds[name], tally.start_seconds[name] = seconds, start_seconds
    tally.options[name] = len(found)
    if not found and solve(_smt_text(bddl.ground(problem.goal, objects))).status == "unsat":
        tally.unsatisfiable.append(name)
    opposite = bddl.ground(bddl.Not(problem.goal), objects)
    session = Solver(_smt_text(opposite))
    constants = {atom: f"a{index}" for index, atom in enumerate(opposite.atoms)}
    for option in {*found, *from_start}:
        if session.check((constants[literal.atom], literal.value) for literal in option).status != "unsat":
            tally.unsound.append(name)
    changes = [sum((literal.atom in true) != literal.value for literal in option) for option in from_start]
    in_order = all(len(first) <= len(second) for first, second in pairwise(found))
    sets = [frozenset(option) for option in found]
    apart = not any(one <= other for one in sets for other in sets if one is not other)
    if not (in_order and apart and changes == sorted(changes) and len(found) == len(from_start)):
        tally.disordered.append(name)
    return found


def _reference(
    name: str, problem: bddl.Problem, peer: GoalPeer, states: list[int], progress: bddl.GoalProgress, tally: _Tally
) -> None:
    """Ask the reference for its options and its rewards, and compares these with what it calls true."""
    about = peer.ask("ground", activity=name, atoms=[atom.label for atom in progress.atoms])
    assert isinstance(about, dict)
    tally.reference_ground_seconds[name] = about["seconds"]
    tally.reference_options[name] = about["options"]
    if about["error"] is not None:
        tally.reference_errors[name] = about["error"]
        return
    texts = [hex(state) for state in states]
    rewards = peer.ask("reward", activity=name, states=texts)
    seconds = peer.ask("time", activity=name, states=texts)
    assert isinstance(rewards, list) and isinstance(seconds, float)
    objects = {thing.name: thing.category for thing in problem.objects}
    judged = compile_goal(problem.goal, objects, pairs="reference")
    for state, reward in zip(states, rewards, strict=True):
        true = judged.evaluate(state)
        if true and reward < 1.0:
            tally.solved_unrewarded[name] = min(reward, tally.solved_unrewarded.get(name, 1.0))
        if not true and reward == 1.0 and name not in tally.unsolved_rewarded:
            tally.unsolved_rewarded.append(name)
    tally.reference_seconds += seconds
    tally.reward_seconds += _timed(lambda: [progress.packed(state) for state in states])[0]
    tally.timed_states += len(states)


def _timed(work: Callable[[], _Answer]) -> tuple[float, _Answer]:
    """Return the least time that some work took, and its answer."""
    best = float("inf")
    for _ in range(TIMES):
        begin = time.perf_counter()
        answer = work()
        best = min(best, time.perf_counter() - begin)
    return best, answer


def _measures(tally: _Tally, activities: int) -> Iterator[Measure]:
    incoherent = len({*tally.solved_unrewarded, *tally.unsolved_rewarded})
    yield Measure(
        f"activities where full progress and truth differ ({tally.states} states, {tally.true} of them true)",
        str(len(tally.incoherent)),
        f"{incoherent} ({len(tally.solved_unrewarded)} solved without, {len(tally.unsolved_rewarded)} unsolved with)",
        "0",
        not tally.incoherent,
    )
    yield Measure("options that do not imply the goal", str(len(tally.unsound)), "", "0", not tally.unsound)
    yield Measure("activities with options out of order", str(len(tally.disordered)), "", "0", not tally.disordered)
    without = [name for name, count in tally.options.items() if not count]
    yield Measure(
        "activities without an option",
        f"{len(without)} ({', '.join(without)})",
        f"{len(tally.reference_errors)} ({', '.join(tally.reference_errors)})",
        "those that z3 refutes",
        without == tally.unsatisfiable,
    )
    fewer = sum(tally.reference_options[name] < count for name, count in tally.options.items())
    yield Measure(f"activities with fewer of the first {OPTIONS} options", "0", str(fewer))
    theirs = tally.reference_ground_seconds
    for label, times in (
        (f"first {OPTIONS} options", tally.option_seconds),
        (f"first {OPTIONS} options from the start", tally.start_seconds),
        ("preparing progress", tally.compile_seconds),
    ):
        together, alone = sum(times.values()), max(times.values())
        yield Measure(
            f"{label}, all {activities} activities",
            f"{together:.2f} s",
            f"{sum(theirs.values()):.2f} s",
            f"{MOST_TOGETHER:g} s",
            together <= MOST_TOGETHER,
        )
        yield Measure(
            f"{label}, slowest activity ({max(times, key=times.__getitem__)})",
            f"{1e3 * alone:.1f} ms",
            f"{1e3 * max(theirs.values()):.1f} ms",
            f"{1e3 * MOST_ALONE:g} ms",
            alone <= MOST_ALONE,
        )
    if tally.timed_states:
        yield Measure(
            "progress of a packed state, beside the reward of a set of facts",
            f"{1e6 * tally.reward_seconds / tally.timed_states:.1f} us",
            f"{1e6 * tally.reference_seconds / tally.timed_states:.1f} us",
        )
