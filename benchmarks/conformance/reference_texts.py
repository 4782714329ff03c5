"""Reads texts with the reference implementation; runs under its interpreter, never under this project's.

Reads one JSON request a line from standard input and writes one JSON answer a line. Requests:

    {"do": "corpus"}                                   -> {name of activity: text}
    {"do": "read", "text": TEXT}                       -> {"name", "objects", "init", "goal"}, or {"error"}
    {"do": "judge", "activity": NAME, "text": TEXT}    -> {"parse", "compile", "verify"}: whether each accepts the text
    {"do": "round_trip", "activity": NAME, "text": TEXT} -> {"equal", "name_kept"}
    {"do": "time", "what": "tokens" or "parse" or "check", "texts": [TEXT, ...]} -> seconds for all of them

To compile means to compile init and goal with a backend that knows every predicate of the domain and its arity; to
verify, to run the checks of `bddl_verification` that look at one activity.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

# The reference prints what it does not recognise; the answers keep standard output for themselves.
ANSWERS = os.fdopen(os.dup(sys.stdout.fileno()), "w")
sys.stdout = sys.stderr

from bddl import bddl_verification as checks  # noqa: E402
from bddl.activity import Conditions, get_goal_conditions, get_initial_conditions, get_object_scope  # noqa: E402
from bddl.config import ACTIVITY_CONFIGS_PATH  # noqa: E402
from bddl.logic_base import BinaryAtomicFormula, UnaryAtomicFormula  # noqa: E402
from bddl.parsing import construct_bddl_from_parsed, parse_domain, parse_problem, scan_tokens  # noqa: E402

DOMAIN = "omnigibson"
PREDICATES = parse_domain(DOMAIN)[-1]
with open(checks.SYNS_TO_PROPS_JSON, encoding="utf-8") as file:
    PROPERTIES = json.load(file)


CLASSES = {
    name: type(
        name,
        (UnaryAtomicFormula if len(inputs) == 1 else BinaryAtomicFormula,),
        {"STATE_NAME": name, "_evaluate": lambda *_: True, "_sample": lambda *_: None},
    )
    for name, inputs in PREDICATES.items()
}


class Backend:
    """A backend that knows the predicates of the domain with their arities."""

    def get_predicate_class(self, name: str) -> type:
        """Return the class of a predicate, as the reference asks its backends."""
        return CLASSES[name]


def parsed(text: str) -> Any:
    """Return name, objects, init and goal; each caller gets lists of its own, since the checks change them."""
    return parse_problem("", 0, DOMAIN, predefined_problem=text)


def compile_text(text: str) -> None:
    """Compiles init and goal."""
    conditions = Conditions("", 0, DOMAIN, predefined_problem=text)
    scope = get_object_scope(conditions)
    get_initial_conditions(conditions, Backend(), scope, generate_ground_options=False)
    get_goal_conditions(conditions, Backend(), scope, generate_ground_options=False)


def verify(activity: str, text: str) -> None:
    """Run the reference's offline checks of one activity."""
    _, objects, init, goal = parsed(text)
    checks.object_list_correctly_formatted(text)
    checks.all_objects_appropriate(objects, init, goal)
    checks.all_objects_placed(init)
    checks.no_invalid_synsets(objects, init, goal, PROPERTIES)
    checks.no_invalid_predicates(init, goal, PREDICATES)
    checks.future_and_real_present(objects, init, goal)
    checks.no_repeat_object_lines(text)
    checks.no_qmarks_in_init(text)
    checks.no_contradictory_init_atoms(init)
    checks.no_uncontrolled_category(activity, text)
    checks.agent_present(init)
    checks.no_misaligned_synsets_predicates(init, goal, PROPERTIES)
    checks.no_unnecessary_specific_containers(objects, init, goal, PROPERTIES)
    checks.no_substances_with_multiple_instances(
        {category: names for category, names in objects.items() if category in PROPERTIES}, PROPERTIES
    )


def passes(step: Callable[[], object]) -> bool:
    """Decide whether a step raises nothing."""
    try:
        step()
    except Exception:
        return False
    return True


def judge(activity: str, text: str) -> dict[str, bool]:
    """Return which steps accept a text; a step that is reached only after a failure accepts nothing."""
    found = {"parse": passes(lambda: parsed(text))}
    found["compile"] = found["parse"] and passes(lambda: compile_text(text))
    found["verify"] = found["compile"] and passes(lambda: verify(activity, text))
    return found


def round_trip(activity: str, text: str) -> dict[str, bool]:
    """Return whether printing and reading again gives the same, and whether the name is kept."""
    name, objects, init, goal = parsed(text)
    try:
        printed = construct_bddl_from_parsed(activity, 0, objects, init, goal)
        again = parsed(printed)
    except Exception:
        return {"equal": False, "name_kept": False}
    return {"equal": list(again[1:]) == list(parsed(text)[1:]), "name_kept": again[0] == name}


def read(text: str) -> dict[str, Any]:
    """Return what the reference reads."""
    try:
        name, objects, init, goal = parsed(text)
    except Exception as error:
        return {"error": f"{type(error).__name__}: {error}"}
    return {"name": name, "objects": objects, "init": init, "goal": goal}


def full_check(text: str) -> None:
    """Parse, compiles and verifies; what fails is of no account."""
    judge("", text)


STEPS: dict[str, Callable[[str], object]] = {
    "tokens": lambda text: scan_tokens(string=text),
    "parse": parsed,
    "check": full_check,
}


def seconds(what: str, texts: list[str]) -> float:
    """Return how long a step takes for all texts."""
    step = STEPS[what]
    begin = time.perf_counter()
    for text in texts:
        step(text)
    return time.perf_counter() - begin


def corpus() -> dict[str, str]:
    """Return the text of every activity."""
    found = {}
    for name in sorted(os.listdir(ACTIVITY_CONFIGS_PATH)):
        path = os.path.join(ACTIVITY_CONFIGS_PATH, name, "problem0.bddl")
        if os.path.isfile(path):
            with open(path, encoding="utf-8") as file:
                found[name] = file.read()
    return found


def answer(request: dict[str, Any]) -> object:
    """Do what a request asks for."""
    match request["do"]:
        case "corpus":
            return corpus()
        case "read":
            return read(request["text"])
        case "judge":
            return judge(request["activity"], request["text"])
        case "round_trip":
            return round_trip(request["activity"], request["text"])
        case "time":
            return seconds(request["what"], request["texts"])
    raise ValueError(request["do"])


if __name__ == "__main__":
    for line in sys.stdin:
        print(json.dumps(answer(json.loads(line))), file=ANSWERS, flush=True)
