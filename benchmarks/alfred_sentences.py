"""What the offline planner makes of people's own instructions for household tasks.

    python -m benchmarks.alfred_sentences FOLDER [--half tuning] [--types simple two] [--show]
    python -m benchmarks.alfred_sentences FOLDER --tests [--half tuning] [--types simple two stacked] [--show]
    python -m benchmarks.alfred_sentences CLONE --drawn 700 [--draw 2] [--without FOLDER ...] [--types ...] [--show]

FOLDER holds the command files of github.com/zebehn/revisiting_alfred (`refined_*_commands.json`, MIT): instructions
that people wrote for tasks of ALFRED, each with the action sequence of its expert. Every task becomes a scene: the
furniture and the things of its sequence, in the categories of AI2-THOR, with a fridge, a stove and other landmarks.
All that stands in it is made here; nothing of the files is kept.

Instructions are unique up to case, blanks and a last full stop, and sorted. Every second one from the first is for
tuning, and the others are for judging once.

With --tests, FOLDER holds `instruction2_params_test_seen.p` and `instruction2_params_test_unseen.p` of
github.com/soyeonm/FILM (MIT): the instructions of ALFRED's two test splits, each with the kind of task, the thing and
the place that a classifier read in it. Seen homes are for tuning, unseen ones for judging once. A home has the places
that its instruction names, wherever they stand. A thing starts at the place that is named after "from", "off" or "out
of", and else on the counter, or on a shelf. Of the types clean, heat, cool, light and sliced nothing can be done here,
so that every plan for them is one for something else.

With --drawn, CLONE is a clone of github.com/askforalfred/alfred (MIT), whose history holds the training annotations.
One of each demonstration is drawn, with a seed, until there are as many sentences as asked for. None of them is in
the files of the folders after --without. The thing and the place are those of the expert's task. The home is made as
for the test splits. --draw 2 goes on where the first draw of as many ended, and so on: other demonstrations, and no
sentence of an earlier draw, by its letters. A draw is for judging once; then it is for tuning.

    understood  a plan that is proved, and whose goal moves the things of the expert's plan, and only these, there
    other       a plan that is proved for something else: to be looked at, since experts and people can disagree
    refused     by the code of the refusal
"""

from __future__ import annotations

import argparse
import json
import pickle
import random
import re
import subprocess
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import bddl
import llm
import oag

_TYPES = {
    "simple": "pick_and_place_simple",
    "two": "pick_two_obj_and_place",
    "stacked": "pick_and_place_with_movable_recep",
    "clean": "pick_clean_then_place_in_recep",
    "heat": "pick_heat_then_place_in_recep",
    "cool": "pick_cool_then_place_in_recep",
    "light": "look_at_obj_in_light",
}
_SPLITS = {"tuning": "seen", "judging": "unseen"}
# The commit of ALFRED's repository whose tree has the annotations, and the seed of the draw.
_ANNOTATIONS = "495d2c39ee3db399696a5c58512faf3c8d8f122c"
_DRAW_SEED = 20261129
_COMMANDS, _TESTS = "refined_*_commands.json", "instruction2_params_test_*seen.p"
# Places of AI2-THOR as people call them; the longer names first.
_CALLED = {
    "coffee table": "coffee_table", "side table": "side_table", "end table": "side_table", "night stand": "side_table",
    "nightstand": "side_table", "dining table": "dining_table", "garbage can": "garbage_can",
    "trash can": "garbage_can", "trash bin": "garbage_can", "waste basket": "garbage_can", "trash": "garbage_can",
    "armchair": "armchair", "bathtub": "bathtub_basin", "vault": "safe", "island": "countertop", "ground": "floor",
    "tv stand": "dresser", "dresser": "dresser", "fridge": "fridge", "refrigerator": "fridge", "microwave": "microwave",
    "cabinet": "cabinet", "cupboard": "cabinet", "drawer": "drawer", "shelf": "shelf", "sofa": "sofa", "couch": "sofa",
    "counter": "countertop", "sink": "sink_basin", "stove": "stove_burner", "toilet": "toilet", "bed": "bed",
    "desk": "desk", "cart": "cart", "safe": "safe", "tub": "bathtub_basin", "chair": "armchair", "ottoman": "ottoman",
    "floor": "floor", "table": "dining_table",
}  # fmt: skip
# Names of AI2-THOR that the sequences write as one word.
_WORDS = (
    "soap_bar", "toilet_paper_hanger", "toilet_paper", "garbage_can", "spray_bottle", "key_chain", "pepper_shaker",
    "salt_shaker", "soap_bottle", "butter_knife", "remote_control", "credit_card", "glass_bottle", "tissue_box",
    "baseball_bat", "hand_towel_holder", "hand_towel", "side_table", "coffee_table", "dining_table", "alarm_clock",
    "wine_bottle", "cell_phone", "bathtub_basin", "sink_basin", "stove_burner", "coffee_machine", "tennis_racket",
    "laundry_hamper", "arm_chair", "dish_sponge", "watering_can",
)  # fmt: skip
_CATEGORY = {word.replace("_", ""): word for word in _WORDS} | {"armchair": "armchair"}
_INTERIORS = frozenset((
    "fridge", "cabinet", "drawer", "microwave", "safe", "garbage_can", "sink_basin", "bathtub_basin", "bowl", "mug",
    "pot", "pan", "cup", "box",
))  # fmt: skip
_DOORS = frozenset(["fridge", "cabinet", "drawer", "microwave", "safe"])
_LANDMARKS = ("fridge", "stove_burner", "dishwasher", "coffee_machine", "television", "toaster", "sink_basin")
_ACTION = re.compile(r"(\w+)\(([^)]*)\)")


@dataclass(frozen=True, slots=True)
class Instruction:
    """One sentence, the expert's plan as pairs of a thing and the place that it is put at, and its task's scene."""

    text: str
    moves: tuple[tuple[str, str], ...]
    scene: oag.Scene


def normalised(text: str) -> str:
    """Return a sentence without what does not tell it from others."""
    return " ".join(text.casefold().split()).rstrip(" .!")


def instructions(folder: Path, types: Sequence[str]) -> list[Instruction]:
    """Return the unique instructions of some types of tasks, sorted."""
    wanted = {_TYPES[name] for name in types}
    found: dict[str, str] = {}
    for path in sorted(folder.glob(_COMMANDS), key=lambda path: ("unseen" in path.name, path.name)):
        for task in json.loads(path.read_text(encoding="utf-8")):
            if task["task_type"] in wanted:
                for text in task["original"]:
                    found.setdefault(normalised(text), task["action_sequence"])
    made = ((text, *scene_of(sequence)) for text, sequence in sorted(found.items()) if text)
    return [Instruction(text, moves, scene) for text, moves, scene in made]


class _Plain(pickle.Unpickler):
    """Reads texts, numbers and collections; whatever else a file names is refused."""

    def find_class(self, module: str, name: str) -> object:
        raise pickle.UnpicklingError(f"{module}.{name} is no plain data")


def split_instructions(folder: Path, half: str, types: Sequence[str]) -> list[Instruction]:
    """Return the unique instructions of a half of the test splits, sorted; none of the others is among them."""
    splits: dict[str, dict[str, dict[str, object]]] = {}
    for name, split in _SPLITS.items():
        with (folder / f"instruction2_params_test_{split}.p").open("rb") as file:
            splits[name] = {normalised(text): read for text, read in _Plain(file).load().items()}
    others = splits["tuning"] if half == "judging" else {}
    found = ((text, *_as_classified(text, read, types)) for text, read in sorted(splits[half].items()))
    return [Instruction(text, moves, scene) for text, moves, scene in found if scene is not None and text not in others]


def drawn_instructions(
    clone: Path, count: int, types: Sequence[str], without: Sequence[Path], draw: int = 1
) -> list[Instruction]:
    """Return instructions of ALFRED's training demonstrations, one of each that is drawn, in the order of the draw.

    Draws of one count and of the same types and folders share no demonstration and no sentence.
    """
    known = {_letters(text) for folder in without for text in _sentences_in(folder)}
    wanted = {_TYPES[name] for name in types}
    trials: dict[str, list[str]] = {}
    paths = _git(clone, "ls-tree", "-r", "--name-only", _ANNOTATIONS, "data/json_2.1.0").splitlines()
    for path in sorted(path for path in paths if "/pp/ann_" in path):
        task, trial = path.split("/")[2:4]
        if task.split("-")[0] in wanted and "Sliced" not in task:
            trials.setdefault(f"{task}/{trial}", []).append(path)
    rng = random.Random(_DRAW_SEED)
    order = sorted(trials)
    rng.shuffle(order)
    found: list[Instruction] = []
    for trial in order:
        annotation = json.loads(_git(clone, "show", f"{_ANNOTATIONS}:{rng.choice(trials[trial])}"))
        told = annotation["turk_annotations"]["anns"][annotation["ann"]["repeat_idx"]]["task_desc"]
        text, letters = normalised(told), _letters(told)
        if annotation["split"] != "train" or letters in known:
            continue
        known.add(letters)
        read = {**annotation["pddl_params"], "task_type": annotation["task_type"], "sliced": False}
        moves, scene = _as_classified(text, read, types)
        if scene is not None:
            found.append(Instruction(text, moves, scene))
        if len(found) == count * draw:
            break
    return found[count * (draw - 1) :]


def _git(clone: Path, *command: str) -> str:
    return subprocess.run(["git", "-C", str(clone), *command], check=True, capture_output=True, text=True).stdout


def _letters(text: str) -> str:
    return " ".join(re.sub("[^a-z0-9 ]", "", normalised(text)).split())


def _sentences_in(folder: Path) -> Iterator[str]:
    for path in folder.glob(_COMMANDS):
        yield from (text for task in json.loads(path.read_text(encoding="utf-8")) for text in task["original"])
    for path in folder.glob(_TESTS):
        with path.open("rb") as file:
            yield from _Plain(file).load()


def _as_classified(
    text: str, read: dict[str, object], types: Sequence[str]
) -> tuple[tuple[tuple[str, str], ...], oag.Scene | None]:
    kind = next(name for name, full in _TYPES.items() if full == read["task_type"])
    treated = kind not in ("simple", "two", "stacked") or read["sliced"]
    if ("sliced" if read["sliced"] and kind in ("simple", "two", "stacked") else kind) not in types:
        return (), None
    thing, vessel, goal = (
        _CATEGORY.get(str(read[key]).lower(), str(read[key]).lower())
        for key in ("object_target", "mrecep_target", "parent_target")
    )
    if kind == "light":
        goal = "desk"
    moves = [(thing, vessel), (vessel, goal)] if kind == "stacked" else [(thing, goal)] * (2 if kind == "two" else 1)
    # "From the top of the brown coffee table": a few words may stand before the name.
    named = re.search(rf"\b(?:from|off|out of)\b(?: \w+){{0,4}}? ({'|'.join(_CALLED)})\b", text)
    start = "shelf" if goal == "countertop" else "countertop"
    if named is not None and (_CALLED[named[1]] != goal or text.count(named[1]) > 1):
        start = _CALLED[named[1]]
    # A home has what its instruction names; a bare "table" is the goal where that is one.
    plain = [name for name in _CALLED if re.search(rf"\b{name}\b", text)]
    spoken = [_CALLED[name] for name in plain if not any(name != longer and name in longer for longer in plain)]
    tables = goal.endswith("table") or goal == "desk"
    there = [place for place in spoken if place != goal and not (tables and place == "dining_table")]
    scene = _scene([(what, start) for what, _ in moves], moves, there)
    return () if treated else tuple(moves), scene


def scene_of(sequence: str) -> tuple[tuple[tuple[str, str], ...], oag.Scene]:
    """Return the moves of an expert's plan by category, and a scene in which it can be followed."""
    actions = [
        (name, [_CATEGORY.get(part.strip(), part.strip()) for part in parts.split(",")])
        for name, parts in _ACTION.findall(sequence)
    ]
    held: list[tuple[str, str]] = []
    moves: list[tuple[str, str]] = []
    place = ""
    things = {args[0] for name, args in actions if name == "PickupObject"}
    for name, args in actions:
        if name == "GotoLocation" and args[0] and args[0] not in things:
            place = args[0]
        elif name == "PickupObject":
            # What is fetched next is where the first thing was, unless the plan goes elsewhere.
            held.append((args[0], place or (held[0][1] if held else "floor")))
        elif name == "PutObject":
            moves.append((args[0], args[1]))
            place = ""
    return tuple(moves), _scene(held, moves)


def _scene(held: Sequence[tuple[str, str]], moves: Sequence[tuple[str, str]], named: Sequence[str] = ()) -> oag.Scene:
    objects: dict[str, dict[str, object]] = {}
    facts: list[str] = []
    goals = list(dict.fromkeys(where for _, where in moves))
    items = {what for what, _ in held}
    for category in goals:
        if category not in items:
            _add(objects, facts, category)
    for what, start in held:
        # What is moved within one kind of furniture starts at another piece of it.
        host = f"{start}_{1 if start in goals else 0}"
        if host not in objects:
            _add(objects, facts, start)
        key = _add(objects, facts, what, item=True)
        facts.append(f"({'inside' if start in _INTERIORS else 'ontop'} {key} {host})")
    for category in goals:
        if category in items and f"{category}_0" not in objects:
            _add(objects, facts, category, item=True)
    for category in (*named, *_LANDMARKS):
        if not any(key.rsplit("_", 1)[0] == category for key in objects):
            _add(objects, facts, category)
    return oag.Scene.from_json(
        {"name": "home", "objects": objects, "facts": facts, "closed": ["ontop", "inside", "open"]}
    )


def _add(objects: dict[str, dict[str, object]], facts: list[str], category: str, *, item: bool = False) -> str:
    """Add a thing: the first piece of furniture with the others close around it, a sink above it, things on it."""
    key = f"{category}_{sum(name.rsplit('_', 1)[0] == category for name in objects)}"
    number = sum(1 for thing in objects.values() if thing["bbox_extent"] not in (_SMALL, _VESSEL))
    across, along = _AROUND[number % len(_AROUND)]
    position = [1.5 + 0.45 * across, 0.45 * along, 0.4]
    if category == "sink_basin":
        position = [1.5, 0.0, 0.95]
    objects[key] = {
        "category": category,
        "position": [1.5, 0.01 * len(objects), 0.85] if item else position,
        "bbox_extent": (_VESSEL if category in _INTERIORS else _SMALL)
        if item
        else [0.4, 0.4, 0.8 if category != "sink_basin" else 0.2],
    }
    if category in _DOORS:
        facts.append(f"(not (open {key}))")
    return key


_AROUND = ((0, 0), (0, 1), (0, -1), (1, 0), (1, 1), (1, -1), (-1, 0), (-1, 1), (-1, -1))
_SMALL, _VESSEL = [0.03, 0.04, 0.06], [0.085, 0.085, 0.06]


def judged(instruction: Instruction) -> tuple[str, str]:
    """Return what becomes of an instruction, and its goal or the refusal."""
    try:
        task = llm.propose(instruction.text, instruction.scene).task
    except llm.QueryError as refusal:
        return refusal.code, refusal.problem
    goal = bddl.format(task.goal)
    if oag.compose(task).verify().verdict is not oag.Verdict.PROVED:
        return "unproved", goal
    wanted = Counter(instruction.moves)
    placed = Counter(_moves(task.goal, instruction.scene))
    return ("understood" if placed and placed <= wanted else "other"), goal


def _moves(goal: bddl.Formula, scene: oag.Scene) -> Iterator[tuple[str, str]]:
    for atom, value in bddl.literals(goal) or ():
        if value and atom.predicate in ("inside", "ontop"):
            names = [scene.objects[key].category if key in scene.objects else key for key in atom.args]
            yield names[0], names[1]


def _asked_for(args: argparse.Namespace, parser: argparse.ArgumentParser) -> list[Instruction]:
    wanted = _TESTS if args.tests else _COMMANDS
    if args.drawn is None:
        if args.without:
            parser.error("--without is for --drawn alone")
        if args.draw is not None:
            parser.error("--draw is for --drawn alone")
        if len(list(args.folder.glob(wanted))) < (2 if args.tests else 1):
            parser.error(
                f"{args.folder} holds not the files {wanted} that are expected there; its help says where from"
            )
        if args.tests:
            return split_instructions(args.folder, args.half or "tuning", args.types)
        return instructions(args.folder, args.types)[1 if args.half == "judging" else 0 :: 2]
    if args.half is not None:
        parser.error("--half is not for --drawn, which has no halves")
    if args.drawn < 1:
        parser.error(f"--drawn {args.drawn}: expected a count of 1 or more")
    if args.draw is not None and args.draw < 1:
        parser.error(f"--draw {args.draw}: expected the number of a draw, 1 or more")
    for folder in args.without:
        if not any(path for pattern in (_COMMANDS, _TESTS) for path in folder.glob(pattern)):
            parser.error(f"--without {folder}: it holds neither {_COMMANDS} nor {_TESTS}")
    try:
        return drawn_instructions(args.folder, args.drawn, args.types, args.without, args.draw or 1)
    except subprocess.CalledProcessError as problem:
        said = problem.stderr.strip().splitlines()
        parser.error(
            f"{args.folder} is no clone of ALFRED with the commit {_ANNOTATIONS}: {said[-1] if said else problem}"
        )


def main() -> None:
    """Print the counts of one half, and with --show every instruction."""
    parser = argparse.ArgumentParser(description="How many of people's instructions the offline planner understands.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--half", choices=("tuning", "judging"), help="not of --drawn (default: tuning)")
    parser.add_argument("--types", nargs="+", choices=(*_TYPES, "sliced"), default=["simple", "two"])
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--tests", action="store_true", help="the instructions of ALFRED's test splits")
    source.add_argument("--drawn", type=int, metavar="COUNT", help="so many instructions of training demonstrations")
    parser.add_argument("--draw", type=int, metavar="NUMBER", help="which draw of --drawn (default: 1)")
    parser.add_argument(
        "--without", nargs="+", type=Path, default=[], help="folders of sentences that --drawn leaves out"
    )
    parser.add_argument("--show", action="store_true")
    args = parser.parse_args()
    half = _asked_for(args, parser)
    counts: Counter[str] = Counter()
    for instruction in half:
        outcome, text = judged(instruction)
        counts[outcome] += 1
        if args.show:
            print(f"{outcome:<20} {instruction.text}\n{'':<20} {text}")
    for outcome, count in counts.most_common():
        print(f"{outcome:<20} {count:>5} {count / len(half):>7.1%}")
    print(f"{'together':<20} {len(half):>5}")


if __name__ == "__main__":
    main()
