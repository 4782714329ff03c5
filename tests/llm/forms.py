"""The forms in which models write an answer, each for the right answers of all modules, Inspector and Supervisor.

A form is either read as the answer that it is, or refused with a finding; it must never be read as another one.
"""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import yaml

import bddl
from llm.evolve.model_inspector import StepCritique
from llm.evolve.model_supervisor import RevisedFlow
from llm.structured.schema import Answer, wire_schema
from oag import Primitive
from oag.model.symbols import ParameterKind, parameter_kind
from tests.llm.evolve.scripted_judges import critique_answer, revision_answer
from tests.llm.scripted_modules import SCHEMAS, right_answers, without_subtask
from tests.source_tree import ROOT

INSPECTOR, SUPERVISOR = 6, 7
KINDS = (1, 2, 3, 4, 5, INSPECTOR, SUPERVISOR)
LISTED = (2, 3, 4, 5)
FLOWS = (5, SUPERVISOR)
FORMULAS = (1, 3)
ANSWERS: Mapping[int, type[Answer]] = {**SCHEMAS, INSPECTOR: StepCritique, SUPERVISOR: RevisedFlow}
Object = dict[str, Any]
# What makes the text of a reply, or the members of a server's message, of a right answer to a kind of question.
Make = Callable[[Object, int], "str | Object"]


def right_answer(kind: int) -> Object:
    """Return the answer that is right for T1, and for its door that was left ajar."""
    if kind == INSPECTOR:
        return critique_answer(5, state_reached="no")
    if kind == SUPERVISOR:
        return revision_answer([17, 1, 2, 3, {"19": [0.0, 0.9]}, 5])
    return copy.deepcopy(right_answers("T1")[kind])


def draft(kind: int) -> Object:
    """Return an answer of the right form that says something else."""
    right = right_answer(kind)
    if kind == 1:
        return {**right, "goal": "(open refrigerator_0)"}
    if kind == INSPECTOR:
        return {**right, "motion_verified": "no", "anomaly": "The door hit the wall."}
    if kind == SUPERVISOR:
        return {**right, "new_sequence": [17, 1, 2, 3, {"19": [0.0, 0.7]}, 5]}
    return without_subtask(right_answers("T1"), kind, 1)


@dataclass(frozen=True)
class Form:
    """One way to write an answer.

    Attributes:
        make: Writes it so.
        reads: True where it has to be read as what it is; False where it has to be refused.
        kinds: Whose answers can be written so.
        finish: Why the model stopped.
    """

    make: Make
    reads: bool = True
    kinds: tuple[int, ...] = KINDS
    finish: str = "stop"


def around(before: str, after: str = "") -> Form:
    """A text before and after the answer, in which DRAFT stands for another answer."""

    def make(right: Object, kind: int) -> str:
        other = json.dumps(draft(kind))
        return before.replace("DRAFT", other) + json.dumps(right) + after.replace("DRAFT", other)

    return Form(make)


def instead(text: str, finish: str = "stop", kinds: tuple[int, ...] = KINDS) -> Form:
    """A text in place of an answer, in which DRAFT stands for another answer."""
    return Form(lambda _, kind: text.replace("DRAFT", json.dumps(draft(kind))), False, kinds, finish)


def textual(change: Callable[[str], str], *, reads: bool = False, kinds: tuple[int, ...] = KINDS) -> Form:
    """The answer's JSON with its text changed."""
    return Form(lambda right, _: change(json.dumps(right)), reads, kinds)


def fields(change: Callable[[Object], object], kinds: tuple[int, ...] = KINDS, *, reads: bool = True) -> Form:
    """The answer with its object changed."""
    return Form(lambda right, _: json.dumps(change(right), ensure_ascii=False), reads, kinds)


def message(members: Callable[[str, str], Object], *, reads: bool = True) -> Form:
    """The members of a server's message, of the answer's text and that of another answer."""
    return Form(lambda right, kind: members(json.dumps(right), json.dumps(draft(kind))), reads)


def walked(value: Any, change: Callable[[Any], Any]) -> Any:
    """Return a JSON value with every leaf changed."""
    if isinstance(value, dict):
        return {key: walked(inner, change) for key, inner in value.items()}
    if isinstance(value, list):
        return [walked(inner, change) for inner in value]
    return change(value)


def of_formulas(change: Callable[[str], object], *, reads: bool = False) -> Form:
    """The answer with its formulas changed."""
    return fields(
        lambda right: walked(right, lambda leaf: change(leaf) if isinstance(leaf, str) and leaf[:1] == "(" else leaf),
        FORMULAS,
        reads=reads,
    )


def of_flows(change: Callable[[int, list[float]], object], *, reads: bool = True) -> Form:
    """The answer with each action written anew, of its primitive and its numbers."""

    def action(item: Any) -> object:
        key, value = next(iter(item.items())) if isinstance(item, dict) else (item, [])
        return change(int(key), value if isinstance(value, list) else [value])

    def make(right: Object) -> Object:
        if "new_sequence" in right:
            return {**right, "new_sequence": [action(item) for item in right["new_sequence"]]}
        entries = [{**entry, "flow": [action(item) for item in entry["flow"]]} for entry in right["sub_tasks"]]
        return {"sub_tasks": entries}

    return fields(make, FLOWS, reads=reads)


def without(*names: str, kinds: tuple[int, ...]) -> Form:
    """The answer, and its entries, without some fields."""

    def make(right: Object) -> Object:
        kept = {key: value for key, value in right.items() if key not in names}
        if "sub_tasks" in kept:
            kept["sub_tasks"] = [{k: v for k, v in entry.items() if k not in names} for entry in kept["sub_tasks"]]
        return kept

    return fields(make, kinds)


def saying(name: str, value: object, kinds: tuple[int, ...]) -> Form:
    """The answer with one field that says something else, or nothing in other words."""
    return fields(lambda right: {**right, name: value}, kinds)


def own(primitive: object, numbers: object) -> Object:
    """Return an action of the wire's form."""
    return {"primitive": primitive, "parameters": numbers}


def named_as(primitive: int) -> str:
    """Return the key that says what the numbers of a primitive are."""
    kinds = {ParameterKind.DISTANCE_M: "distance", ParameterKind.ANGLE_DEG: "degrees"}
    return kinds.get(parameter_kind(Primitive(primitive)), "limits")


def paper(primitive: object, numbers: list[float]) -> object:
    """Return an action of the paper's form."""
    return {primitive: numbers[0] if len(numbers) == 1 else numbers} if numbers else primitive


def is_prose(leaf: object) -> bool:
    """Decide whether a value is a text in words."""
    return isinstance(leaf, str) and " " in leaf and "(" not in leaf


def saying_anew(name: str, change: Callable[[Any], object], kinds: tuple[int, ...]) -> Form:
    """The answer with one field written in another form."""
    return fields(lambda right: {**right, name: change(right[name])}, kinds)


def of_entries(change: Callable[[Object], Object]) -> Form:
    """The answer with its entries changed."""
    return fields(lambda right: {"sub_tasks": [change(entry) for entry in right["sub_tasks"]]}, LISTED)


def renamed(right: Object, change: Callable[[str], str]) -> Object:
    """Return an answer, and its entries, with other names of fields."""
    entries = [{change(key): value for key, value in entry.items()} for entry in right.get("sub_tasks", ())]
    return {change(key): entries if key == "sub_tasks" else value for key, value in right.items()}


def in_camel_case(name: str) -> str:
    first, *rest = name.split("_")
    return first + "".join(map(str.capitalize, rest))


def conjuncts(text: str) -> tuple[bddl.Formula, ...]:
    formula = bddl.parse_formula(text)
    return formula.parts if isinstance(formula, bddl.And) else (formula,)


def functional(text: str) -> str:
    """Return a formula as `inside(a, b) and not open(b)`."""
    written = []
    for part in conjuncts(text):
        atom = part.body if isinstance(part, bddl.Not) else part
        assert isinstance(atom, bddl.Atom)
        call = f"{atom.predicate}({', '.join(atom.args)})"
        written.append(f"not {call}" if atom is not part else call)
    return " and ".join(written)


def nested(formula: bddl.Formula) -> list[object]:
    """Return a formula as `["not", ["open", "b"]]`."""
    if isinstance(formula, bddl.Not):
        return ["not", nested(formula.body)]
    assert isinstance(formula, bddl.Atom)
    return [formula.predicate, *formula.args]


def calls(right: Object) -> str:
    """Return the text of an answer with its actions as calls."""
    made = of_flows(lambda key, n: f"{Primitive(key).name}({', '.join(map(str, n))})").make(right, 0)
    assert isinstance(made, str)
    return made


def numbered(right: Object) -> Object:
    """Return the paper's form of a list of subtasks."""
    return {f"sub_task_{entry['sub_task']}": entry for entry in right["sub_tasks"]}


FORMS: dict[str, Form] = {
    "plain": around(""),
    "indented": fields(lambda right: right),
    "fenced as json": around("```json\n", "\n```"),
    "fenced": around("```\n", "\n```\n"),
    "prose before": around("Sure! Here is the answer you asked for:\n\n"),
    "prose after": around("", "\n\nLet me know if you need anything else."),
    "braces in prose": around("A set {a, b} and {braces}. ", " With {care}."),
    "byte order mark": around("\ufeff"),
    "blank lines": around("\n\n\t ", "\r\n\r\n"),
    "a schema first": Form(lambda right, kind: json.dumps(wire_schema(ANSWERS[kind])) + json.dumps(right)),
    "a schema last": Form(lambda right, kind: json.dumps(right) + json.dumps(wire_schema(ANSWERS[kind]))),
    "an example first": around('As in {"primitive": 7, "parameters": [0.2]}: '),
    "twice the same": Form(lambda right, _: f"{json.dumps(right)}\nAgain:\n{json.dumps(right)}"),
    "more fields": fields(lambda right: {"reasoning": "...", **right, "confidence": 0.9, "notes": {"a": [1]}}),
    "think": around("<think>DRAFT</think>"),
    "empty think": around("<think>\n\n</think>\n\n"),
    "thinking": around("<thinking>Perhaps DRAFT?</thinking>"),
    "think in capitals": around("<THINK>DRAFT</THINK>"),
    "reasoning": around("<reasoning>DRAFT</reasoning>"),
    "reflection": around("<reflection>DRAFT</reflection>"),
    "think in brackets": around("[THINK]DRAFT[/THINK]"),
    "think in triangles": around("◁think▷DRAFT◁/think▷"),
    "begin of thought": around("<|begin_of_thought|>DRAFT<|end_of_thought|>"),
    "a thought without its beginning": around("Let me see. DRAFT</think>\n"),
    "thoughts before and after": around("<think>DRAFT</think>", "<think>DRAFT</think>"),
    "channels": around(
        "<|channel|>analysis<|message|>DRAFT<|end|><|start|>assistant<|channel|>final<|message|>", "<|return|>"
    ),
    "channels with a constraint": around(
        "<|channel|>analysis<|message|>DRAFT<|end|><|channel|>final <|constrain|>json<|message|>"
    ),
    "channels without their beginning": around("DRAFT<|end|><|start|>assistant<|channel|>final<|message|>"),
    "channels without marks": around("analysisDRAFTassistantfinal"),
    "draft and final answer": around("Draft: DRAFT\nFinal answer: "),
    "untagged thoughts": around("First I thought of DRAFT, but the door is closed. So: "),
    "a mended answer": around("DRAFT Wait, that is wrong. ```json\n", "```"),
    "a box": around("<|begin_of_box|>", "<|end_of_box|>"),
    "an answer tag": around("<answer>", "</answer>"),
    "unclosed think": instead("<think>Perhaps DRAFT", finish="length"),
    "unclosed reasoning": instead("<reasoning>Perhaps DRAFT"),
    "analysis only": instead("<|channel|>analysis<|message|>DRAFT<|end|>"),
    "thought only": instead("DRAFT</think>"),
    "draft, then cut off": instead('Draft: DRAFT Final answer: {"sub_task', finish="length"),
    "draft, then broken": instead('Draft: DRAFT Final answer: {"goal": "(open a)", "sub_tasks": [}'),
    "draft, then Python": instead("Draft: DRAFT Final answer: {'goal': '(open a)'}"),
    "empty": instead(""),
    "blanks": instead(" \n "),
    "refusal in prose": instead("I'm sorry, but I can't help with that."),
    "a question back": instead("Which glass do you mean?"),
    "null": instead("null"),
    "an empty object": instead("{}"),
    "an empty list": instead("[]"),
    "a text in JSON": textual(json.dumps, reads=True),
    "no content": message(lambda *_: {"content": None}, reads=False),
    "reasoning only": message(lambda _, other: {"content": None, "reasoning_content": other}, reads=False),
    "a tool call": message(
        lambda right, _: {"content": None, "tool_calls": [{"function": {"name": "answer", "arguments": right}}]},
    ),
    "declined": message(lambda *_: {"content": None, "refusal": "I can't help with that."}, reads=False),
    "reasoning beside": message(lambda right, other: {"content": right, "reasoning_content": other}),
    "parts": message(lambda right, _: {"content": [{"type": "text", "text": right[:9]}, {"text": right[9:]}]}),
    "parts with thoughts": message(
        lambda right, other: {"content": [{"type": "thinking", "text": other}, {"type": "text", "text": right}]}
    ),
    "whole, but at its limit": Form(lambda right, _: json.dumps(right), finish="length"),
    "cut off": Form(lambda right, _: json.dumps(right)[:-7], False, finish="length"),
    "trailing comma": textual(lambda text: f"{text[:-1]},}}", reads=True),
    "trailing commas": textual(lambda text: re.sub(r"([\]}])", r",\1", text).replace("[,]", "[]"), reads=True),
    "comment": textual(lambda text: text.replace("{", "{ // the answer\n", 1), reads=True),
    "comments of Python": textual(lambda text: text.replace("{", "{ # the answer\n"), reads=True),
    "comments of C": textual(lambda text: text.replace(": ", ": /* so: */ "), reads=True, kinds=FLOWS),
    "Python": Form(lambda right, _: repr(right)),
    "smart quotes": textual(lambda text: text.replace('"', "“"), reads=True),
    "smart quotes in pairs": textual(lambda text: re.sub(r'"([^"]*)"', "“\\1”", text), reads=True),
    "escaped underscores": textual(lambda text: text.replace("_", "\\_"), reads=True),
    "a raw newline": textual(lambda text: '{"x": "a\nb", ' + text[1:], reads=True),
    "signs without width": textual(lambda text: text.replace("_", "_\u200b"), reads=True),
    "hard blanks": textual(lambda text: text.replace('": ', '":\u00a0'), reads=True),
    "without its last brace": textual(lambda text: text[:-1], reads=True),
    "without its last brace, fenced": textual(lambda text: f"```json\n{text[:-1]}\n```", reads=True),
    "without its first brace": textual(lambda text: text[1:], reads=True),
    "without its outer braces": textual(lambda text: text[1:-1], reads=True),
    "YAML": Form(lambda right, _: yaml.safe_dump(right, sort_keys=False, width=10_000)),
    "YAML, fenced": Form(lambda right, _: f"```yaml\n{yaml.safe_dump(right, sort_keys=False)}```\nThat is all."),
    "an object a line": Form(lambda right, _: "\n".join(map(json.dumps, right["sub_tasks"])), kinds=LISTED),
    "a key twice": textual(lambda text: '{"x": 1, "x": 1, ' + text[1:]),
    "not a number": textual(lambda text: '{"x": NaN, ' + text[1:]),
    "beyond all numbers": textual(lambda text: '{"x": 1e999, ' + text[1:], reads=True),
    "thousands of digits": textual(lambda text: f'{{"x": {"9" * 5_000}, ' + text[1:]),
    "unquoted keys": Form(lambda right, _: re.sub(r'"(\w+)":', r"\1:", json.dumps(right))),
    "in a wrapper": fields(lambda right: {"answer": right}),
    "in a wrapper with words": fields(lambda right: {"thoughts": "...", "status": "ok", "result": right}),
    "in a list of one": fields(lambda right: [right]),
    "draft and answer in one": Form(lambda right, kind: json.dumps({"draft": draft(kind), "final": right}), False),
    "two wrappers deep": fields(lambda right: {"response": {"content": right}}),
    "a bare list": fields(lambda right: right["sub_tasks"], LISTED),
    "numbered subtasks": fields(numbered, LISTED),
    "numbered subtasks in a list": fields(lambda right: {"sub_tasks": numbered(right)}, LISTED),
    "numbers as sub_task_1": of_entries(lambda entry: {**entry, "sub_task": f"sub_task_{entry['sub_task']}"}),
    "camel case": fields(lambda right: renamed(right, in_camel_case)),
    "names with hyphens": fields(lambda right: renamed(right, lambda name: name.replace("_", "-"))),
    "flows by subtask": fields(lambda right: {k: v["flow"] for k, v in numbered(right).items()}, (5,)),
    "the paper's names": fields(
        lambda right: {
            "task_activity_name": right["task_activity_name"],
            "task_detail_message": f"{right['task_name']}. {right['task_message_detail']}",
            "goal": right["goal"],
        },
        (1,),
    ),
    "a description in lines": saying_anew("task_message_detail", lambda text: text.split(". "), (1,)),
    "without numbers of subtasks": without("sub_task", kinds=LISTED),
    "without what is not needed": without(
        "problem", "bddl_category", "root_cause", "root_cause_step", "sub_task", "step",
        "state_contrast", "anomaly", kinds=KINDS,
    ),
    "the paper's supervisor": fields(
        lambda right: {"VLM-Observation": {"Step 0": "..."}, **{k: right[k] for k in ("reason", "new_sequence")}},
        (SUPERVISOR,),
    ),
    "the paper's iteration": Form(
        lambda right, _: f'"iter_1": {json.dumps({key: right[key] for key in ("reason", "new_sequence")})}',
        kinds=(SUPERVISOR,),
    ),
    "problem None": saying("problem", "None", (1, SUPERVISOR)),
    "problem null": saying("problem", None, (1, SUPERVISOR)),
    "problem N/A": saying("problem", "N/A", (1, SUPERVISOR)),
    "problem in a sentence": saying("problem", "There are no problems.", (1, SUPERVISOR)),
    "a problem that is none": Form(
        lambda right, _: json.dumps({**right, "problem": "It can be done."}), False, (1, SUPERVISOR)
    ),
    "no anomaly observed": saying("anomaly", "No anomalies observed.", (INSPECTOR,)),
    "no anomaly or collision": saying("anomaly", "No collisions or unexpected motion in this step.", (INSPECTOR,)),
    "anomaly null": saying("anomaly", None, (INSPECTOR,)),
    "a long diagnosis": saying("observation", "The door stays ajar. " * 62, (INSPECTOR,)),
    "a long reason": saying("reason", "The door stays ajar. " * 62, (SUPERVISOR,)),
    "a long root cause": saying("root_cause", "The door stays ajar. " * 9, (SUPERVISOR,)),
    "judgements as true and false": saying("motion_verified", True, (INSPECTOR,)),
    "judgements in capitals": saying("state_reached", "No.", (INSPECTOR,)),
    "strings for numbers": fields(
        lambda right: walked(right, lambda leaf: str(leaf) if type(leaf) in (int, float) else leaf),
        (*LISTED, INSPECTOR, SUPERVISOR),
    ),
    "emoji": fields(lambda right: walked(right, lambda leaf: f"{leaf} 🧊" if is_prose(leaf) else leaf)),
    "another script": fields(lambda right: {**right, "備考": "冷蔵庫を開ける"}),
    "upper-case predicates": of_formulas(lambda text: text.replace("open", "OPEN"), reads=True),
    "functional formulas": of_formulas(functional, reads=True),
    "a goal section": of_formulas(lambda text: f"(:goal {text})", reads=True),
    "in for inside": of_formulas(lambda text: text.replace("inside", "in").replace("open", "opened"), reads=True),
    "closed": of_formulas(lambda text: re.sub(r"\(not \(open (\w+)\)\)", r"(closed \1)", text), reads=True),
    "a parenthesis too many": of_formulas(lambda text: f"{text})", reads=True),
    "a parenthesis too few": of_formulas(lambda text: text[:-1], reads=True),
    "formulas in a list": of_formulas(lambda text: [bddl.format(part) for part in conjuncts(text)], reads=True),
    "formulas as lists": of_formulas(lambda text: [nested(part) for part in conjuncts(text)], reads=True),
    "formulas in backticks": of_formulas(lambda text: f"`{text}`", reads=True),
    "actions of the wire": of_flows(lambda key, numbers: own(key, numbers)),
    "names as primitives": of_flows(lambda key, numbers: own(Primitive(key).name, numbers)),
    "names as actions": of_flows(lambda key, numbers: paper(Primitive(key).name, numbers)),
    "names in small letters": of_flows(lambda key, n: own(Primitive(key).name.lower().replace("_", " "), n)),
    "IDs as texts": of_flows(lambda key, numbers: own(str(key), numbers)),
    "parameters as an object": of_flows(lambda key, numbers: own(key, numbers or {})),
    "parameters left out": of_flows(lambda key, numbers: own(key, numbers) if numbers else {"primitive": key}),
    "nested limits": of_flows(lambda key, numbers: own(key, [numbers] if len(numbers) == 2 else numbers)),
    "one parameter": of_flows(lambda key, n: {"primitive": key, "parameter": n[0] if len(n) == 1 else n or None}),
    "steps numbered": of_flows(lambda key, numbers: {"step": 1, "comment": "so", **own(key, numbers)}),
    # A key says what its numbers are: a distance is no angle, and no limit of a joint.
    "numbers elsewhere": of_flows(lambda key, n: {"primitive": key, **({named_as(key): n} if n else {})}),
    "numbers of another kind": of_flows(lambda key, n: {"primitive": key, "angle_deg": n or 0.5}, reads=False),
    "named numbers": of_flows(lambda key, n: own(key, {"value": n}) if n else own(key, [])),
    "a range by its ends": of_flows(lambda key, n: own(key, {"from": n[0], "to": n[1]} if len(n) == 2 else n)),
    "ID and value": of_flows(lambda key, n: {"id": key, "value": n[0] if len(n) == 1 else n or None}),
    "action and value": of_flows(lambda key, n: {"action": Primitive(key).name, "value": n}),
    "an ID beside another name": of_flows(
        lambda key, n: {"id": 21, "skill": Primitive(key).name, "value": n}, reads=False
    ),
    "an ID beside a text": of_flows(lambda key, n: {"id": key, "skill": "as before", "value": n}, reads=False),
    "ID, name and parameters": of_flows(lambda key, n: {"id": key, "name": Primitive(key).name, "parameters": n}),
    "calls": of_flows(lambda key, n: f"{Primitive(key).name}({', '.join(map(str, n))})"),
    "calls without quotes": Form(lambda right, _: re.sub(r'"(\w+\([^"()]*\))"', r"\1", calls(right)), kinds=FLOWS),
    "a name and a number": of_flows(
        lambda key, n: f"{Primitive(key).name} {n[0]}" if len(n) == 1 else paper(str(key), n)
    ),
    "another number": of_flows(lambda key, n: {"primitive": key, "speed": 0.4}, reads=False),
    "two numbers": of_flows(lambda key, n: {"primitive": key, "distance": 0.4, "value": 0.5}, reads=False),
    "a quotient": Form(lambda right, _: json.dumps(right).replace("0.71", "0.05/0.07"), False, (4,)),
    "112 kB of opening thoughts": instead("<think>" * 16_000 + "DRAFT"),
    "200,000 braces": instead("{" * 200_000),
    "a list of 100,000 objects": instead('{"sub_tasks": [' + "{}, " * 90_000 + '{}]}'),
    "a flow of 90,000 actions": instead('{"new_sequence": [' + "17, " * 90_000 + '17], "reason": "so"}'),
}  # fmt: skip


def answer_codes() -> frozenset[str]:
    """Return the codes of findings about answers that the page about models lists."""
    page = (ROOT / "docs" / "models.md").read_text(encoding="utf-8")
    return frozenset(re.findall(r"^\| `(answer/[a-z-]+)` \|", page, re.MULTILINE))
