"""Base schema of all answers: strict types, bounded texts, actions of flows, and a flat JSON schema for the wire.

Every field is requested and has one type: a text, a number, a list or an object. Some endpoints reject unions,
optional fields and references. A field that is not needed may still be missing. Fields that a model adds are
ignored and have no effect.

The paper's flows `[18, {"15": 0.3}, {"19": [0.0, 0.6]}, 5]` mix integers and objects, which the schemas of the
wire cannot express. On the wire each action is `{"primitive": 15, "parameters": [0.3]}`. Both forms are read.

pydantic is loaded when a model is first asked, not with `llm`.
"""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Self, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    JsonValue,
    ModelWrapValidatorHandler,
    WithJsonSchema,
)
from pydantic import model_validator as validator
from pydantic_core import PydanticCustomError

import bddl
from llm.client.transport import BOUNDS, FORMS
from llm.structured.values import as_formula, as_number, as_ordinal, plain_name
from oag import Action, Primitive
from oag.model.actions import action_from_json
from oag.model.diagnostics import FlowError
from oag.model.symbols import ParameterKind, parameter_kind

MOST_SUBTASKS = 24
MOST_ACTIONS = 40
LONGEST_NAME = 120
LONGEST_TEXT = 6_000
LONGEST_REMARK = 1_200
LONGEST_FORMULA = 4_000
# Of a field that is read where it is given, and not asked for: what it says is known, or follows from the others.
UNASKED: dict[str, JsonValue] = {"asked": False}


class Answer(BaseModel):
    """An answer, or an object inside one.

    Class attributes:
        list_name: The field that holds numbered subtasks; the paper's `sub_task_1`, `sub_task_2` are read into it.
    """

    model_config = ConfigDict(extra="ignore", strict=True, frozen=True, allow_inf_nan=False)
    list_name: ClassVar[str] = ""

    def resolved(self) -> Answer:
        """Return the answer as it is understood; a refused answer is shown in this form."""
        return self

    def with_entries(self, other: Self, numbers: Collection[int]) -> Self:
        """Return this answer with the entries of some numbers from another one, or that one where it has others."""
        mine, theirs = (getattr(one, self.list_name) for one in (self, other))
        changed = {entry.sub_task: entry for entry in theirs}
        if changed.keys() != {*numbers} or len(theirs) != len(changed):
            return other
        return self.model_copy(update={self.list_name: [changed.get(entry.sub_task, entry) for entry in mine]})

    def shown(self) -> str:
        """Return the resolved answer as JSON for the model; fields that were not asked for only where it wrote them."""
        return json.dumps(_written(self.resolved()))

    @classmethod
    def found_in(cls, value: object, depth: int = 3) -> dict[str, object] | None:
        """Return the answer that a JSON value is or wraps, None without one.

        It is an object with one of the fields, the bare list of numbered entries, or an object around one of these.
        """
        answer = cls._looked_like(value)
        # A repeated schema has a member for each field as well.
        if answer is not None or not isinstance(value, dict) or "properties" in value or not depth:
            return answer
        wrapped = [inner for part in value.values() if (inner := cls.found_in(part, depth - 1)) is not None]
        return wrapped[0] if wrapped and all(inner == wrapped[0] for inner in wrapped) else None

    @classmethod
    def _looked_like(cls, value: object) -> dict[str, object] | None:
        """Return an object with one of the fields, or wrap a list of entries; None for other values."""
        if isinstance(value, dict):
            numbered = bool(cls.list_name) and any(_number(key) is not None for key in value)
            return value if numbered or cls._has_field(value) else None
        if not cls.list_name or not isinstance(value, list) or not value:
            return None
        is_listed = all(isinstance(item, dict) and cls._entry()._has_field(item) for item in value)
        return {cls.list_name: value} if is_listed else None

    @classmethod
    def _entry(cls) -> type[Answer]:
        """Return the class of the entries of the list."""
        return get_args(cls.model_fields[cls.list_name].annotation)[0]

    @classmethod
    def _has_field(cls, value: Mapping[object, object]) -> bool:
        known = {plain_name(name) for name in cls.model_fields}
        return any(isinstance(key, str) and plain_name(key) in known for key in value)

    @validator(mode="wrap")
    @classmethod
    def _with_near_names(cls, data: object, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Read the paper's numbered subtasks; for a missing field report the name that may stand for it."""
        if not isinstance(data, dict) or not all(isinstance(key, str) for key in data):
            return handler(data)
        data = cls._as_asked(data)
        for name in cls.model_fields:
            if name not in data:
                keys = [key for key in data if key.isidentifier() and len(key) <= LONGEST_NAME]
                near = [key for key in bddl.near_names(name, keys) if key not in cls.model_fields]
                if near:
                    context = {"name": name, "near": near[0]}
                    raise PydanticCustomError("missing", "the field {name} is missing; {near} is no field", context)
        return handler(data)

    @classmethod
    def _as_asked(cls, data: Mapping[str, object]) -> dict[str, object]:
        """Convert an object to the requested form: numbered subtasks in a list, by position if unnumbered."""
        plain = dict(data)
        for name in cls.model_fields:
            spelt = [key for key in plain if plain_name(key) == plain_name(name)]
            if name not in plain and len(spelt) == 1:
                plain[name] = plain.pop(spelt[0])
        if not cls.list_name:
            return plain
        listed = plain.get(cls.list_name, plain)
        if isinstance(listed, Mapping):
            keys = [key for key in listed if _number(key) is not None]
            numbered = {_number(key): key for key in keys}
            if keys and len(numbered) == len(keys):
                values = [(cls._as_entry(listed[key]), number) for number, key in sorted(numbered.items()) if number]
                plain[cls.list_name] = [_with_number(value, number) for value, number in values]
        entries = plain.get(cls.list_name)
        if isinstance(entries, list) and all(isinstance(item, Mapping) and not _has_number(item) for item in entries):
            plain[cls.list_name] = [_with_number(item, number) for number, item in enumerate(entries, start=1)]
        return plain

    @classmethod
    def _as_entry(cls, value: object) -> object:
        """Return a list as the entry whose only list it is, such as a flow; other values as they are."""
        names = [name for name, field in cls._entry().model_fields.items() if get_origin(field.annotation) is list]
        return {names[0]: value} if isinstance(value, list) and len(names) == 1 else value


_SUBTASK_KEY = re.compile(r"(?:sub[ _-]?task[ _-]?)(\d{1,3})", re.IGNORECASE)


def _number(key: object) -> int | None:
    found = _SUBTASK_KEY.fullmatch(key) if isinstance(key, str) else None
    return None if found is None else int(found[1])


def _has_number(entry: Mapping[str, object]) -> bool:
    return any(plain_name(key) == "subtask" for key in entry)


def _with_number(value: object, number: int) -> object:
    return {"sub_task": number, **value} if isinstance(value, Mapping) else value


def without_control(text: str, besides: str = "") -> str:
    """Return a text; raise for pydantic if it has control characters other than `besides`."""
    for character in text:
        if unicodedata.category(character) in ("Cc", "Cf", "Cs") and character not in besides:
            code = {"code": f"U+{ord(character):04X}"}
            raise PydanticCustomError("control_character", "the text has the control character {code}", code)
    return text


def _printable(text: str) -> str:
    return without_control(text, "\n\t").strip()


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _underscored(text: str) -> str:
    return "_".join(text.split())


def _lines(value: object) -> object:
    """Join a text that is written as a list of lines."""
    lines = isinstance(value, list) and all(isinstance(line, str) for line in value)
    return "\n".join(value) if isinstance(value, list) and lines else value


def _empty_for_none(value: object) -> object:
    """Replace null, false and their equivalents in words by the empty text."""
    return "" if value is None or value is False or (isinstance(value, str) and is_empty_remark(value)) else value


def _trimmed(longest: int) -> Callable[[str], str]:
    """Return a validator that truncates a text: a long diagnosis is no worse than a short one."""
    return lambda text: text if len(text) <= longest else f"{text[: longest - 3]}..."


Text = Annotated[str, BeforeValidator(_lines), Field(max_length=LONGEST_TEXT), AfterValidator(_printable)]
Sentence = Annotated[
    str, BeforeValidator(_lines), Field(min_length=1, max_length=LONGEST_TEXT), AfterValidator(_printable)
]
MaybeText = Annotated[Text, BeforeValidator(_empty_for_none)]
# A remark may be absent; an empty text says that there is none.
Remark = Annotated[MaybeText, AfterValidator(_trimmed(LONGEST_REMARK))]
Reason = Annotated[Sentence, AfterValidator(_trimmed(LONGEST_REMARK))]
Line = Annotated[
    str, Field(min_length=1, max_length=LONGEST_NAME), AfterValidator(_printable), AfterValidator(_one_line)
]
MaybeLine = Annotated[MaybeText, AfterValidator(_one_line), AfterValidator(_trimmed(LONGEST_NAME))]
_ONE, _ONE_OR_NONE = "one", "one or none"
Formula = Annotated[
    str,
    BeforeValidator(as_formula),
    Field(min_length=1, max_length=LONGEST_FORMULA, json_schema_extra={"formula": _ONE}),
    AfterValidator(_printable),
]
MaybeFormula = Annotated[MaybeText, Field(json_schema_extra={"formula": _ONE_OR_NONE}), BeforeValidator(as_formula)]
ObjectId = Annotated[
    str, Field(min_length=1, max_length=LONGEST_NAME, json_schema_extra={"ids": _ONE}), AfterValidator(_printable)
]
# An empty text says that there is no such object.
MaybeObjectId = Annotated[
    str,
    BeforeValidator(_empty_for_none),
    Field(max_length=LONGEST_NAME, json_schema_extra={"ids": _ONE_OR_NONE}),
    AfterValidator(_printable),
]
# Valid as a name in BDDL texts and of files.
ActivityName = Annotated[
    str,
    BeforeValidator(lambda value: _underscored(value) if isinstance(value, str) else value),
    Field(min_length=1, max_length=LONGEST_NAME, pattern=r"^[A-Za-z][A-Za-z0-9_.\-]*$"),
]
Number = Annotated[int, BeforeValidator(as_ordinal), Field(ge=1, le=MOST_SUBTASKS)]
StepNumber = Annotated[int, BeforeValidator(as_ordinal), Field(ge=1, le=1_000)]
# Requested as an integer on the wire; may be missing.
_INTEGER = WithJsonSchema({"type": "integer"})
MaybeNumber = Annotated[Number | None, _INTEGER]
MaybeStepNumber = Annotated[StepNumber | None, _INTEGER]


class SubtaskAnswer(Answer):
    """Part of an answer about one subtask."""

    sub_task: Number = Field(description="number of the subtask")


_NONE = frozenset({"", "null", "none", "nil", "n/a", "not applicable", "-", "–", "—"})
_DENYING = frozenset({"no", "none", "nothing", "without"})


def _words(listed: str) -> frozenset[str]:
    return frozenset(listed.split())


# Words whose absence is good news ...
_BAD = _words(
    "anomaly anomalies abnormality abnormalities irregularity irregularities deviation deviations problem problems "
    "issue issues fault faults error errors collision collisions anomalous abnormal unusual unexpected unintended "
    "undesired unwanted wrong report"
)
# ... and words around them that do not change the meaning.
_AROUND = _words(
    "there is are was were has have been be observed detected seen found noted noticed visible identified apparent "
    "evident obvious present reported occurred during in at of to for with the this that a any all or and other "
    "step action motion movement movements behavior behaviour event events contact contacts"
)
_WORD = re.compile(r"[a-z]+")
_LONGEST = 200


def is_empty_remark(text: str) -> bool:
    """Decide whether a remark states that there is nothing to report, such as "None" or "No anomalies observed."

    Models write such texts where an empty one was requested; read as remarks they would become faults and refusals.
    Only words without any other meaning are read so: "No contact was made" is a remark.
    """
    plain = text.strip().rstrip(".!").lower()
    if plain in _NONE:
        return True
    words = _WORD.findall(plain) if len(plain) <= _LONGEST else []
    first = next((word for word in words if word not in ("there", "is", "are", "was", "were")), "")
    if first not in _DENYING or not all(word in _BAD or word in _AROUND or word in _DENYING for word in words):
        return False
    return first == "none" or any(word in _BAD for word in words)


def begins_with_denial(text: str) -> bool:
    """Decide whether a text begins like a remark that there is nothing to report."""
    words = _WORD.findall(text[:_LONGEST].lower())
    return bool(words) and words[0] in (*_DENYING, "not")


_KEPT = ("type", "description", "enum", *(key for key in BOUNDS if key != "pattern"))
# Grammars expand the bound of a text; what is longer than this is too long for any answer.
_LONGEST_WRITTEN = 600
_MOST_IDS = 100


def _written(value: object) -> object:
    """Return a part of an answer as plain data, without empty fields that were not asked for."""
    if isinstance(value, list):
        return [_written(item) for item in value]
    if not isinstance(value, Answer):
        return value
    fields = type(value).model_fields
    return {name: _written(part) for name, part in value if part or fields[name].json_schema_extra != UNASKED}


class Pattern(str):
    """The regular expression of the texts that a field admits."""


# What some fields of an entry admit together: the texts, or their pattern.
Form = Mapping[str, Pattern | Sequence[str] | Sequence[int]]


@dataclass(frozen=True, slots=True)
class Admitted:
    """What an answer may name and say, for endpoints that hold a schema strictly.

    Attributes:
        ids: The objects that fields of ids may name; without any, or with very many, every text is legal.
        entries: Length of the answer's list; 0 where it is not known.
        formulas: Pattern of its formulas; without one every text is legal.
        forms: Alternatives of an entry: what some of its fields admit together.
    """

    ids: Sequence[str] = ()
    entries: int = 0
    formulas: str = ""
    forms: Sequence[Form] = ()


ANYTHING = Admitted()
"""No bounds besides those of the answer's fields."""


def wire_schema(answer: type[Answer], admitted: Admitted = ANYTHING, numbers: Sequence[int] = ()) -> dict[str, object]:
    """Return the JSON schema of an answer for endpoints: no references, unions or optional fields.

    Bounds (`llm.client.transport.BOUNDS`) are sent to endpoints that know them, and checked when the answer arrives.

    Args:
        answer: The answer.
        admitted: What it may name and say.
        numbers: The entries that it has, where these are not all.
    """
    full = answer.model_json_schema()
    ids = admitted.ids if len(admitted.ids) <= _MOST_IDS else ()
    written = _flat(full, full.get("$defs", {}), ids, admitted.formulas)
    properties = written["properties"]
    if not answer.list_name or not isinstance(properties, dict):
        return written
    listed = properties[answer.list_name]
    count = len(numbers) or admitted.entries
    if count:
        listed |= {"minItems": count, "maxItems": count}
    if numbers:
        listed["items"]["properties"]["sub_task"]["enum"] = [*numbers]
    forms = [form for form in admitted.forms if not numbers or {*form.get("sub_task", numbers)} & {*numbers}]
    if forms:
        listed["items"][FORMS] = [{"properties": _narrowed(form)} for form in forms]
    return written


def _narrowed(form: Form) -> dict[str, object]:
    return {name: {"pattern": one} if isinstance(one, Pattern) else {"enum": [*one]} for name, one in form.items()}


def _flat(
    node: Mapping[str, object], known: Mapping[str, Mapping[str, object]], ids: Sequence[str], formulas: str
) -> dict[str, object]:
    """Expand the references of a schema; answers nest three levels deep, and none contains itself."""
    reference = node.get("$ref")
    if isinstance(reference, str):
        return _flat(known[reference.rpartition("/")[2]], known, ids, formulas)
    written = {key: node[key] for key in _KEPT if key in node}
    longest = written.get("maxLength")
    if isinstance(longest, int):
        written["maxLength"] = min(longest, _LONGEST_WRITTEN)
    if node.get("ids") and ids:
        written["enum"] = [*ids] if node["ids"] == _ONE else ["", *ids]
    if node.get("formula") and formulas:
        # The pattern bounds the length as well.
        written.pop("maxLength", None)
        written["pattern"] = f"^{formulas}$" if node["formula"] == _ONE else f"^{formulas}?$"
    items, properties = node.get("items"), node.get("properties")
    if isinstance(items, Mapping):
        written["items"] = _flat(items, known, ids, formulas)
    if isinstance(properties, Mapping):
        asked = {key: value for key, value in properties.items() if value.get("asked", True)}
        written["properties"] = {key: _flat(value, known, ids, formulas) for key, value in asked.items()}
        written["required"] = list(asked)
        written["additionalProperties"] = False
    if written.get("type") == "object":
        # A docstring is for readers of the code.
        written.pop("description", None)
    return written


_LONGEST_PROBLEM = 240
# Keys of an action whose value names the primitive, the likeliest first; these two may name something else as well.
_AMBIGUOUS_KEYS = ("name", "id")
_PRIMITIVE_KEYS = ("primitive", "primitive_id", "action", "action_id", *_AMBIGUOUS_KEYS)
# Keys that say what their numbers are, and those of any numbers.
_KIND_OF_KEY = {
    **dict.fromkeys(("distance", "distance_m"), ParameterKind.DISTANCE_M),
    **dict.fromkeys(("angle", "angle_deg", "degrees"), ParameterKind.ANGLE_DEG),
    "limits": ParameterKind.JOINT_LIMITS,
}
_NUMBER_KEYS = (
    "parameters", "parameter", "params", "param", "values", "value", "args", "arguments", *_KIND_OF_KEY
)  # fmt: skip
# The ends of a range, in pairs.
_ENDS = (("from", "to"), ("low", "high"), ("min", "max"), ("lower", "upper"), ("start", "end"))
# Keys whose numbers are no parameters of the motion.
_KNOWN_KEYS = (*_PRIMITIVE_KEYS, *_NUMBER_KEYS, "step", "index", "number")
_NO_NUMBERS: tuple[object, ...] = (None, "", [], {})
# A primitive with its numbers in one text: GRASP(), LIFT_EEF_UP(0.2), 19(0, 0.6), MOVE_BASE_LEFT 0.3.
_CALL = re.compile(r"([A-Za-z][A-Za-z_ -]*|\d{1,2})\s*(?:\(([-+.,\s\deE]*)\)|\s([-+.\d]+)\s*(m?))")


class WrittenAction(Answer):
    """One action: the ID of its primitive and its numbers, which may be omitted for the executor to fill in."""

    primitive: int
    parameters: list[float] = Field(max_length=2)

    def action(self) -> Action:
        """Return the action; `verify` checks whether its numbers fit the primitive."""
        numbers = tuple(self.parameters)
        parameter = None if not numbers else numbers[0] if len(numbers) == 1 else (numbers[0], numbers[1])
        return Action(Primitive(self.primitive), parameter)


def _step(item: object) -> object:
    """Convert an action from any of its forms to the form of the wire."""
    called = _CALL.fullmatch(item.strip()) if isinstance(item, str) else None
    if called is not None and _primitive_of(called[1]) is not None:
        item = _called(called)
    own = isinstance(item, Mapping) and any(key in item for key in _PRIMITIVE_KEYS)
    written: object = _own_form(item) if own and isinstance(item, Mapping) else _with_id(item)
    try:
        action = action_from_json(written)
    except FlowError as error:
        hint = f"; did you mean {' or '.join(error.near)}?" if error.near else ""
        raise _refused(error.code, error.problem, hint) from None
    values = action.parameter if isinstance(action.parameter, tuple) else (action.parameter,)
    return {"primitive": int(action.primitive), "parameters": [value for value in values if value is not None]}


def _refused(code: str, problem: str, hint: str = "") -> PydanticCustomError:
    short = problem if len(problem) <= _LONGEST_PROBLEM else f"{problem[:_LONGEST_PROBLEM]}..."
    return PydanticCustomError(code, "{problem}", {"problem": short + hint})


def _called(found: re.Match[str]) -> object:
    """Convert an action that is written as a call; a length only where the primitive takes one."""
    primitive = _primitive_of(found[1])
    is_length = primitive is not None and parameter_kind(primitive) is ParameterKind.DISTANCE_M
    if found[4] and not is_length:
        raise _refused("flow/parameter", f"{found[1]} takes no length, got {found[0]!r}")
    numbers = [part.strip() for part in (found[2] or found[3] or "").split(",")]
    return {"primitive": found[1], "parameters": [as_number(part) for part in numbers if part]}


def _primitive_of(named: object) -> Primitive | None:
    """Return the primitive that an ID or a name means; None for others."""
    found = as_number(_id(named))
    return Primitive(found) if isinstance(found, int) and found in {*Primitive} else None


def _own_form(item: Mapping[str, object]) -> object:
    """Convert an action with keys to the paper's form, mistakes included."""
    keys = [key for key in _PRIMITIVE_KEYS if key in item]
    named = [item[key] for key in keys]
    # A primitive may have its name and its ID; beside both, an ID is that of the step.
    primitives = {_primitive_of(name) for name in named}
    meant = _primitive_of(named[0])
    words = {found for value in item.values() if (found := _primitive_by_name(value)) is not None}
    if ("primitive" not in item and len(primitives) > 1) or (meant is not None and words - {meant}):
        raise _refused("flow/unknown-primitive", f"it names more than one primitive: {dict(item)!r}")
    other = [key for key, value in item.items() if key not in _KNOWN_KEYS and isinstance(value, str) and value.strip()]
    if keys[0] in _AMBIGUOUS_KEYS and other and not words:
        problem = f"either {keys[0]!r} or {other[0]!r} may name the primitive; write it under primitive"
        raise _refused("flow/unknown-primitive", problem)
    primitive, numbers = named[0], _numbers(item, meant)
    return _id(primitive) if numbers == [] else {str(_id(primitive)): numbers[0] if len(numbers) == 1 else numbers}


def _primitive_by_name(value: object) -> Primitive | None:
    """Return the primitive whose name a text is; None for others, IDs among them."""
    return _primitive_of(value) if isinstance(value, str) and as_number(value) == value else None


def _numbers(item: Mapping[str, object], primitive: Primitive | None) -> list[object]:
    """Return the numbers of an action with keys; raise where it cannot be known which they are."""
    given = [key for key in _NUMBER_KEYS if key in item and item[key] not in _NO_NUMBERS]
    if len(given) > 1:
        raise _refused("flow/parameter", f"numbers stand under more than one key: {', '.join(map(repr, item))}")
    if given:
        _check_kind(given[0], primitive)
        numbers = item[given[0]]
        if isinstance(numbers, Mapping):
            numbers = _of_mapping(numbers, primitive)
        return [as_number(number) for number in numbers] if isinstance(numbers, list) else [as_number(numbers)]
    # A number under another key would be lost, and a different motion executed.
    astray = [key for key, value in item.items() if key not in _KNOWN_KEYS and not isinstance(value, str | None)]
    if astray:
        raise _refused("flow/parameter", f"numbers stand under parameters, not under {astray[0]!r}")
    return []


def _check_kind(key: str, primitive: Primitive | None) -> None:
    """Raise where numbers have a key of another kind than the primitive's: half a degree is not half a metre."""
    kind = _KIND_OF_KEY.get(key)
    if kind is not None and primitive is not None and parameter_kind(primitive) is not kind:
        takes = parameter_kind(primitive).value
        raise _refused("flow/parameter", f"{primitive.name} takes {takes}; its numbers stand under {key!r}")


def _of_mapping(numbers: Mapping[str, object], primitive: Primitive | None) -> object:
    """Return the only number of a mapping, or the two ends of a range; the mapping itself if it has others."""
    if len(numbers) == 1 and (key := next(iter(numbers))) in _NUMBER_KEYS:
        _check_kind(key, primitive)
        return numbers[key]
    return next(([numbers[low], numbers[high]] for low, high in _ENDS if {low, high} == {*numbers}), numbers)


def _with_id(item: object) -> object:
    if isinstance(item, Mapping) and len(item) == 1:
        ((key, value),) = item.items()
        if value in _NO_NUMBERS:
            return _id(key)
        numbers = [as_number(number) for number in value] if isinstance(value, list) else as_number(value)
        return {str(_id(key)): numbers}
    return _id(item) if isinstance(item, str) else item


def _id(primitive: object) -> object:
    """Return a primitive's ID for its name; anything that is neither becomes a text that can be shown."""
    if isinstance(primitive, str):
        name = "_".join(primitive.upper().split())
        return int(Primitive[name]) if name in Primitive.__members__ else primitive
    return primitive if isinstance(primitive, int) else repr(primitive)


_WRITTEN_STEP = {"type": "string", "maxLength": 40, "description": "a primitive, such as GRASP or LIFT_EEF_UP(0.2)"}
WireStep = Annotated[WrittenAction, BeforeValidator(_step), WithJsonSchema(_WRITTEN_STEP)]
