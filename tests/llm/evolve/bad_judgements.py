"""Wrong answers of Inspector and Supervisor by the thousand: right ones with one fault, and what has to name it."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from tests.llm.bad_answers import INJECTED, INVENTED, JSON_CODES
from tests.llm.evolve.scripted_judges import as_reply, critique_answer, revision_answer

Who = Literal["inspector", "supervisor"]
# An answer, and the codes of which at least one must be reported.
Made = tuple[object, set[str]]
Right = dict[str, Any]

RIGHT_FLOW: list[Any] = [17, 1, 2, 3, {"19": [0.0, 0.9]}, 5]
FAILED_FLOW: list[Any] = [17, 1, 2, 3, {"19": [0.0, 0.5]}, 5]
STEP = 5


@dataclass(frozen=True)
class BadJudgement:
    """A reply that must never be taken.

    Attributes:
        who: Who gets it.
        fault: What was done to the right answer.
        reply: The reply.
        codes: Codes of which at least one must be reported.
    """

    who: Who
    fault: str
    reply: str
    codes: frozenset[str]


def right_answer(who: Who) -> Right:
    """Return an answer that would be taken."""
    return critique_answer(STEP, state_reached="no") if who == "inspector" else revision_answer(RIGHT_FLOW)


def generate(seed: int) -> BadJudgement:
    """Return the bad answer of a seed; equal seeds give equal answers."""
    chance = random.Random(seed)
    who: Who = chance.choice(("inspector", "supervisor"))
    fault = chance.choice([*OF_BOTH, *OF_ONE[who]])
    answer, codes = fault(chance, right_answer(who))
    return BadJudgement(who, fault.__name__, as_reply(answer), frozenset(codes))


def cut(chance: random.Random, right: Right) -> Made:
    """The text ends early; only the last brace is missing where all the rest is there."""
    text = json.dumps(right)
    return text[: chance.randint(1, len(text) - 2)], JSON_CODES


def no_json(chance: random.Random, right: Right) -> Made:
    """There is no answer at all."""
    return chance.choice(["", "I see nothing.", "null", "[]", "yes", "{}", "{'a': 1}", "{" * 99, "\x00"]), JSON_CODES


def python_text(chance: random.Random, right: Right) -> Made:
    """The answer is a call in Python, or holds constants that JSON lacks."""
    if chance.random() < 0.5:
        return repr(right).replace(": ", "="), JSON_CODES
    ending = chance.choice(["NaN}", "Infinity}", "9" * 4400 + "}"])
    return json.dumps({**right, "extra": 0})[:-2] + ending, {"answer/broken-json"}


def twice_the_same_key(chance: random.Random, right: Right) -> Made:
    """A field is there twice."""
    key = next(iter(right))
    return f'{{"{key}": {json.dumps(right[key])}, ' + json.dumps(right)[1:], {"answer/broken-json"}


def huge(chance: random.Random, right: Right) -> Made:
    """The reply, or a text in it, is longer than anything that could be meant."""
    if chance.random() < 0.5:
        return "x" * 500_000, {"answer/too-long"}
    texts = [key for key, value in right.items() if isinstance(value, str)]
    right[chance.choice(texts)] = "so " * 3_000
    return right, {"answer/field"}


def field_missing(chance: random.Random, right: Right) -> Made:
    """A field that is needed is left out."""
    needed = ("motion_verified", "state_reached", "observation", "reason", "new_sequence")
    del right[chance.choice([key for key in right if key in needed])]
    return right, {"answer/field", "answer/empty-flow"}


def field_of_another_type(chance: random.Random, right: Right) -> Made:
    """A field has another type."""
    key = chance.choice(list(right))
    right[key] = chance.choice([{"a": 1}, [[1]], 2.5, 10**30, [None]])
    return right, {"answer/field", "flow/parameter", "flow/unknown-primitive"}


def steering_text(chance: random.Random, right: Right) -> Made:
    """A text holds signs that steer a terminal, or that cannot be seen."""
    texts = [key for key, value in right.items() if isinstance(value, str)]
    right[chance.choice(texts)] = "fine" + chance.choice(["\x1b[2J", "\u202e", "\x00", "\u2066"]) + "."
    return right, {"answer/field"}


def injected(chance: random.Random, right: Right) -> Made:
    """The reply is an instruction, or claims what only a check can say."""
    return chance.choice(INJECTED), JSON_CODES


def another_step(chance: random.Random, right: Right) -> Made:
    """The critique is about a step that was not asked about."""
    right["step"] = chance.choice([n for n in (1, 2, 6, 7, 999) if n != STEP])
    return right, {"answer/step"}


def no_step(chance: random.Random, right: Right) -> Made:
    """There is no such step."""
    key = "step" if "step" in right else "root_cause_step"
    right[key] = chance.choice([0, -1, 1001, 10**9, "five", True])
    return right, {"answer/field"}


def another_word(chance: random.Random, right: Right) -> Made:
    """A judgement is none of the three words."""
    key = chance.choice(["motion_verified", "state_reached"])
    right[key] = chance.choice(["maybe", "", "PROVED", "yes, but", "perhaps", None, 1])
    return right, {"answer/field"}


def nothing_said(chance: random.Random, right: Right) -> Made:
    """The diagnosis is empty."""
    key = "observation" if "observation" in right else "reason"
    right[key] = ""
    return right, {"answer/field"}


def invented_primitive(chance: random.Random, right: Right) -> Made:
    """The flow uses a primitive that does not exist."""
    bad: list[object] = [0, 22, -1, 10**9, 2.5, True, None, "TELEPORT", "os.system", {"99": 1}, {"FLY": 0.1}, [1], {}]
    flow = right["new_sequence"]
    flow[chance.randrange(len(flow))] = chance.choice(bad)
    return right, {"flow/unknown-primitive", "flow/parameter"}


def parameter_out_of_range(chance: random.Random, right: Right) -> Made:
    """A number is too large, negative, of another form, or given where none belongs."""
    bad: list[object] = [
        {"7": 30},
        {"13": -0.4},
        {"20": 720},
        {"7": [0.1, 0.2]},
        {"4": 0.5},
        {"19": [0.9, 0.1]},
        {"3": 0.4},
        {"7": "x"},
        {"7": 1e300},
        {"17": 1},
        {"primitive": 7, "parameters": [1, 2, 3]},
        {"19": [0, 100]},
    ]
    flow = right["new_sequence"]
    flow.insert(chance.randrange(len(flow) + 1), chance.choice(bad))
    return right, {"flow/parameter", "answer/field"}


def repeated_failure(chance: random.Random, right: Right) -> Made:
    """The flow is one that failed already, perhaps in other words."""
    within = round(0.5 + chance.uniform(-0.009, 0.009), 4)
    right["new_sequence"] = chance.choice(
        [
            FAILED_FLOW,
            [17, 1, 2, 3, {"19": [0.0, within]}, 5],
            [17, 17, 1, 2, 3, {"19": [0.0, 0.5]}, 5],
            [{"7": 0.0}, *FAILED_FLOW],
            [{"13": 0.1}, {"14": 0.1}, *FAILED_FLOW],
        ]
    )
    return right, {"revision/repeated"}


def goal_missed(chance: random.Random, right: Right) -> Made:
    """The flow lacks its grasp, its motion of the door or its order, or does the reverse."""
    right["new_sequence"] = chance.choice(
        [
            [17, 1, 2, 3, 5],
            [17, 1, 2, {"19": [0.0, 0.9]}, 5],
            [17],
            [17, 1, 2, 3, {"4": [0.0, 0.9]}, 5],
            [5, 6],
        ]
    )
    return right, {"flow/goal-not-reached", "flow/precondition", "context/refuted", "goal/not-reached", "flow/kind"}


def endless(chance: random.Random, right: Right) -> Made:
    """The flow has far too many steps."""
    right["new_sequence"] = [6] * chance.choice([41, 2_000])
    return right, {"answer/field"}


def no_flow(chance: random.Random, right: Right) -> Made:
    """There is neither a flow nor a reason why there is none, or both."""
    if chance.random() < 0.5:
        right["new_sequence"] = []
        return right, {"answer/empty-flow"}
    right["problem"] = "it cannot be done"
    return right, {"answer/contradictory"}


def another_subtask(chance: random.Random, right: Right) -> Made:
    """The flow is for a subtask that was not run, or does not exist."""
    right["sub_task"] = chance.choice([0, 1, 2, 3, 5, 25, -1, chance.choice(INVENTED)])
    return right, {"answer/step", "answer/field"}


def step_beyond(chance: random.Random, right: Right) -> Made:
    """The root cause lies in a step that the flow does not have."""
    right["root_cause_step"] = chance.choice([7, 8, 40, 999])
    return right, {"answer/step"}


Fault = Callable[[random.Random, Right], Made]
OF_BOTH: tuple[Fault, ...] = (
    cut,
    no_json,
    python_text,
    twice_the_same_key,
    huge,
    field_missing,
    field_of_another_type,
    steering_text,
    injected,
    no_step,
    nothing_said,
)
OF_ONE: dict[Who, tuple[Fault, ...]] = {
    "inspector": (another_step, another_word),
    "supervisor": (
        invented_primitive,
        parameter_out_of_range,
        repeated_failure,
        goal_missed,
        endless,
        no_flow,
        another_subtask,
        step_beyond,
    ),
}
