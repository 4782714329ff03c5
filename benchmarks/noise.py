"""A model of how repeated decompositions of one task differ in writing. It is no language model, and imitates none.

`variant` writes a task in another way that means the same; `corrupted` breaks one thing in it first. Everything is
drawn from a seeded generator, so that every text can be made again.
"""

from __future__ import annotations

import copy
import random
import re
from collections.abc import Callable
from dataclasses import dataclass

import bddl
from benchmarks.noise_tasks import BaseTask, Json

# Words for one thing that a model may use for another; each only where the scene has one such object.
_ALIASES = {"refrigerator": "fridge", "cabinet": "cupboard", "counter": "countertop"}
_VERBS = ("do", "perform", "handle", "execute", "step for", "now")
_ID = re.compile(r"\b[a-z_]+_\d+\b")


@dataclass(frozen=True)
class Variant:
    """A task written in another way.

    Attributes:
        task: The task file's JSON.
        changes: What was done, in order.
    """

    task: Json
    changes: tuple[str, ...]


class _Noise:
    """One variant under way."""

    def __init__(self, base: BaseTask, rng: random.Random) -> None:
        self.base = base
        self.rng = rng
        self.changes: list[str] = []
        self.blocks = [list(copy.deepcopy(block)) for block in base.blocks]
        self.goal = list(base.goal)
        # A subtask that was broken on purpose; merging or cutting it could mend it by chance.
        self.broken: Json | None = None

    def chance(self, probability: float, change: str) -> bool:
        """Decide whether to make a change, and notes it."""
        made = self.rng.random() < probability
        if made:
            self.changes.append(change)
        return made

    def reorder(self) -> None:
        """Put independent blocks in any order that the dependences allow."""
        left = list(range(len(self.blocks)))
        order: list[int] = []
        while left:
            ready = [i for i in left if not any((j, i) in self.base.before for j in left)]
            order.append(self.rng.choice(ready))
            left.remove(order[-1])
        if order != sorted(order):
            self.changes.append("reorder")
        self.blocks = [self.blocks[i] for i in order]

    def repeat(self) -> None:
        """Say a block, or a subtask of it, twice; the second time its condition is what the first one left."""
        block = self.rng.choice(self.blocks)
        if len(block) == 2:
            pick, put = copy.deepcopy(block)
            rests = re.search(r"\((ontop|inside) [^()\s]+ (?!gripper)[^()\s]+\)", put["goal"])
            left = rests[0] if rests else put["goal"]
            again = {"support_init": put["support_goal"], "init": left, "goal": f"(inside {pick['target']} gripper)"}
            block.extend(({**pick, **again}, put))
        else:
            block.insert(1, {**copy.deepcopy(block[0]), "init": block[0]["goal"]})

    def merge(self) -> None:
        """Write a picking up and the putting down after it as one subtask."""
        block = self.rng.choice(self.blocks)
        for at in range(len(block) - 1):
            first, second = block[at], block[at + 1]
            if self.broken is first or self.broken is second:
                continue
            if "gripper" in second["init"] and 17 in first["flow"][:1] and 5 not in first["flow"]:
                merged = {**second, "support_init": first["support_init"], "init": first["init"]}
                merged["flow"] = [*first["flow"], *second["flow"]]
                block[at : at + 2] = [merged]
                return

    def split(self) -> None:
        """Cut one movement of a subtask off as a subtask of its own."""
        block = self.rng.choice(self.blocks)
        at = self.rng.randrange(len(block))
        whole = block[at]
        cuts = [] if whole is self.broken else self._cuts(whole)
        if not cuts:
            return
        cut, between = self.rng.choice(cuts)
        # A goal that named a place would say that the first half puts the thing there.
        reached = between or (
            "(and)" if "gripper" not in whole["init"] and "open" not in whole["init"] else whole["init"]
        )
        before = {**whole, "goal": reached, "flow": whole["flow"][:cut]}
        after = {**whole, "init": between or whole["init"], "flow": whole["flow"][cut:]}
        if cut == len(whole["flow"]) - 1 and whole["flow"][cut] == 6 and not between:
            before, after = {**before, "goal": whole["goal"]}, {**after, "init": whole["goal"]}
        block[at : at + 1] = [before, after]

    def _cuts(self, subtask: Json) -> list[tuple[int, str | None]]:
        """Place where a flow can be cut, with what holds there when it is not the initial condition."""
        flow, target = subtask["flow"], subtask["target"]
        cuts: list[tuple[int, str | None]] = []
        if flow[0] in (17, 18) and len(flow) > 1:
            cuts.append((1, None))
        if 3 in flow and 5 not in flow and flow.index(3) + 1 < len(flow) and "open" not in subtask["goal"]:
            cuts.append((flow.index(3) + 1, f"(inside {target} gripper)"))
        if 3 in flow and "open" in subtask["goal"] and flow.index(3) + 1 < len(flow):
            cuts.append((flow.index(3) + 1, None))
        if flow[0] == 18 and 5 in flow and flow.index(5) > 1:
            cuts.append((flow.index(5), None))
        if flow[-1] == 6 and len(flow) > 1:
            # Before the hand has backed out with a thing, it may still be inside.
            cuts.append((len(flow) - 1, f"(inside {target} gripper)" if 3 in flow and 5 not in flow else None))
        return cuts

    def wander(self) -> None:
        """Put a subtask in that only drives somewhere."""
        block = self.rng.choice(self.blocks)
        places = [i for i, subtask in enumerate(block) if subtask["flow"][0] in (17, 18)]
        if not places:
            return
        at = self.rng.choice(places)
        following = block[at]
        somewhere = self.rng.choice([*self.base.scene["objects"]])
        # A drive whose goal named its own target's place would say that it puts the target there.
        rests = re.search(rf"\((ontop|inside) {somewhere} ", following["init"])
        reason = "(and)" if rests else self.rng.choice(["(and)", following["init"]])
        drive = {
            "task_activity_name": "navigate",
            "task_detail_message": "Drive there.",
            "target": somewhere,
            "support_init": None,
            "support_goal": None,
            "init": reason,
            "goal": reason,
            "flow": [17],
        }
        block.insert(at, drive)

    def say_more(self) -> None:
        """Add to a goal what its flow brings about anyway."""
        for block in self.blocks:
            for subtask in block:
                target, goal = subtask["target"], subtask["goal"]
                if 3 in subtask["flow"] and 7 in _ids(subtask["flow"]) and 5 not in subtask["flow"]:
                    subtask["goal"] = f"(and (inside {target} gripper) {goal})"
                elif subtask["flow"][0] == 18 and 5 in subtask["flow"]:
                    subtask["goal"] = f"(and {goal} (not (inside {target} gripper)))"

    def drop_first_way(self, subtasks: list[Json]) -> None:
        """Let the first flow begin where the reset puts the robot."""
        flow = subtasks[0]["flow"]
        if flow[0] == 17 and len(flow) > 1:
            subtasks[0]["flow"] = flow[1:]


def variant(base: BaseTask, seed: int, corrupt: Callable[[_Noise], str | None] | None = None) -> Variant:
    """Return a task in another wording.

    Args:
        base: The task.
        seed: Decides everything.
        corrupt: Breaks something first, and says what; for `corrupted`.
    """
    rng = random.Random(f"{base.name} {seed}")
    noise = _Noise(base, rng)
    if corrupt is not None:
        noise.changes.append(corrupt(noise) or "nothing")
    noise.reorder()
    if noise.chance(0.3, "say more"):
        noise.say_more()
    for probability, change, make in (
        (0.35, "repeat", noise.repeat),
        (0.35, "merge", noise.merge),
        (0.3, "merge", noise.merge),
        (0.4, "split", noise.split),
        (0.3, "split", noise.split),
        (0.35, "navigation", noise.wander),
        (0.2, "navigation", noise.wander),
    ):
        if noise.chance(probability, change):
            make()
    subtasks = [subtask for block in noise.blocks for subtask in block]
    if noise.chance(0.5, "start from the reset"):
        noise.drop_first_way(subtasks)
    for number, subtask in enumerate(subtasks):
        verb = rng.choice(_VERBS)
        subtask["task_activity_name"] = f"{verb} {subtask['target']} {number}"
        subtask["task_detail_message"] = f"{verb.title()} it, carefully."
    task: Json = {"task_activity_name": base.name, "goal": _conjunction(noise.goal, rng), "scales": dict(base.scales)}
    if noise.chance(0.6, "names"):
        _respell(subtasks, task, base, rng)
    for subtask in subtasks:
        for key in ("init", "goal"):
            subtask[key] = _reworded(subtask[key], rng)
    return Variant(_shuffled(task, subtasks, rng), tuple(noise.changes))


def corrupted(base: BaseTask, seed: int) -> Variant:
    """Return a task in another wording in which one thing is wrong; the first of its changes says which."""
    kinds = (_dropped_step, _wrong_object, _flipped_goal, _swapped_roles)
    return variant(base, seed, kinds[seed % len(kinds)])


def _dropped_step(noise: _Noise) -> str:
    block = noise.rng.choice(noise.blocks)
    del block[noise.rng.randrange(len(block))]
    if not block:
        # An empty block keeps its place, so that the order of the others is drawn as before.
        block_index = noise.blocks.index(block)
        others = [i for i in range(len(noise.blocks)) if i != block_index]
        moved = {old: new for new, old in enumerate(others)}
        bridged = {(a, c) for a, b in noise.base.before for d, c in noise.base.before if b == d == block_index}
        kept = {(a, b) for a, b in noise.base.before | bridged if block_index not in (a, b)}
        before = frozenset((moved[a], moved[b]) for a, b in kept)
        noise.blocks = [noise.blocks[i] for i in others]
        noise.base = BaseTask(**{**noise.base.__dict__, "before": before})
    return "dropped step"


def _wrong_object(noise: _Noise) -> str:
    subtask = noise.broken = noise.rng.choice([s for block in noise.blocks for s in block])
    roles = [subtask[role] for role in ("target", "support_init", "support_goal") if subtask[role] is not None]
    wrong = noise.rng.choice(roles)
    other = noise.rng.choice([name for name in noise.base.scene["objects"] if name not in roles])
    for key in ("target", "support_init", "support_goal", "init", "goal"):
        if subtask[key] is not None:
            subtask[key] = re.sub(rf"\b{wrong}\b", other, subtask[key])
    return "wrong object"


def _flipped_goal(noise: _Noise) -> str:
    if noise.rng.random() < 0.25:
        at = noise.rng.randrange(len(noise.goal))
        noise.goal[at] = _negated(noise.goal[at])
    else:
        subtask = noise.broken = noise.rng.choice([s for block in noise.blocks for s in block])
        subtask["goal"] = _negated(subtask["goal"])
    return "flipped goal"


def _swapped_roles(noise: _Noise) -> str:
    subtask = noise.broken = noise.rng.choice(noise.rng.choice([b for b in noise.blocks if len(b) > 1] or noise.blocks))
    first, second = noise.rng.choice(
        [("target", "support_init"), ("target", "support_goal"), ("support_init", "support_goal")]
    )
    if subtask[first] == subtask[second] or None in (subtask["target"], subtask[first] or subtask[second]):
        first, second = "support_init", "support_goal"
    if "target" in (first, second) and None in (subtask[first], subtask[second]):
        first, second = "support_init", "support_goal"
    subtask[first], subtask[second] = subtask[second], subtask[first]
    return "swapped roles"


def _negated(literal: str) -> str:
    return literal[5:-1] if literal.startswith("(not ") else f"(not {literal})"


def _ids(flow: list[object]) -> set[int]:
    return {int(next(iter(item))) if isinstance(item, dict) else int(str(item)) for item in flow}


def _conjunction(parts: list[str], rng: random.Random) -> str:
    shuffled = rng.sample(parts, len(parts))
    return shuffled[0] if len(shuffled) == 1 else f"(and {' '.join(shuffled)})"


def _reworded(text: str, rng: random.Random) -> str:
    """Write a formula in another way: conjuncts shuffled, predicates in capitals, negations doubled."""
    parts = [str(part) for part in bddl.conjuncts(bddl.parse_formula(text))]
    if parts and rng.random() < 0.1:
        parts.append(parts[0])
    if parts and rng.random() < 0.1:
        parts[0] = f"(not (not {parts[0]}))"
    written = f"(and {' '.join(rng.sample(parts, len(parts)))})" if len(parts) != 1 or rng.random() < 0.2 else parts[0]
    return re.sub(r"\((ontop|inside|open)\b", lambda m: m[0].upper(), written) if rng.random() < 0.15 else written


def _respell(subtasks: list[Json], task: Json, base: BaseTask, rng: random.Random) -> None:
    """Write names of objects in other ways, each occurrence for itself."""
    objects = list(base.scene["objects"])
    stems = [name.rsplit("_", 1)[0] for name in objects]

    def spelled(match: re.Match[str]) -> str:
        name = match[0]
        stem, number = name.rsplit("_", 1)
        if name not in objects:
            return name
        ways = [name, name.upper(), name.capitalize(), name.replace("_", "-")]
        if stems.count(stem) == 1:
            ways += [stem, stem.title()]
            if stem in _ALIASES and _ALIASES[stem] not in stems:
                ways += [_ALIASES[stem], f"{_ALIASES[stem]}_{number}"]
        return rng.choice(ways)

    for subtask in subtasks:
        for key in ("init", "goal", "target", "support_init", "support_goal"):
            if subtask[key] is not None:
                subtask[key] = _ID.sub(spelled, subtask[key])
        for key in ("target", "support_init", "support_goal"):
            if subtask[key] is not None and rng.random() < 0.3:
                subtask[key] = rng.choice(["the ", ""]) + subtask[key].replace("_", " ")
    task["goal"] = _ID.sub(spelled, task["goal"])
    task["scales"] = {_ID.sub(spelled, name): factor for name, factor in task["scales"].items()}


def _shuffled(task: Json, subtasks: list[Json], rng: random.Random) -> Json:
    """Return the file with its keys in any order, its subtasks as a list or numbered."""
    mixed = [{key: subtask[key] for key in rng.sample(sorted(subtask), len(subtask))} for subtask in subtasks]
    if rng.random() < 0.3:
        task = {**task, **{f"sub_task_{number}": subtask for number, subtask in enumerate(mixed, start=1)}}
    else:
        task = {**task, "sub_tasks": mixed}
    return {key: task[key] for key in rng.sample(sorted(task), len(task))}
