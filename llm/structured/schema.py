"""Base schema of all answers: strict types, bounded texts, actions of flows, and a flat JSON schema for the wire.

Every field is requested and has one type: a text, a number, a list or an object. Some endpoints reject unions,
optional fields and references. A field that is not needed may still be missing. Fields that a model adds are
ignored and have no effect.

The paper's flows `[18, {"15": 0.3}, {"19": [0.0, 0.6]}, 5]` mix integers and objects, which the schemas of the
wire cannot express. On the wire each action is `{"primitive": 15, "parameters": [0.3]}`. Both forms are read.

pydantic is loaded when a model is first asked, not with `llm`.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Mapping
from typing import Annotated, ClassVar, Self, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    WithJsonSchema,
)
from pydantic import model_validator as validator
from pydantic_core import PydanticCustomError

import bddl
from oag import Action, Primitive
from oag.model.actions import action_from_json
from oag.model.diagnostics import FlowError

MOST_SUBTASKS = 24
MOST_ACTIONS = 40
LONGEST_NAME = 120
LONGEST_TEXT = 6_000
LONGEST_REMARK = 1_200
LONGEST_FORMULA = 4_000


class Answer(BaseModel):
    """An answer, or an object inside one.

    Class attributes:
        list_name: The field that holds numbered subtasks; the paper's `sub_task_1`, `sub_task_2` are read into it.
    """

    model_config = ConfigDict(extra="ignore", strict=True, frozen=True, allow_inf_nan=False)
    list_name: ClassVar[str] = ""

    @classmethod
    def found_in(cls, value: object) -> dict[str, object] | None:
        """Return the answer that a JSON value is or wraps, None without one.

        It is an object with one of the fields, the bare list of numbered entries, or an object around one of these.
        """
        answer = cls._looked_like(value)
        # A repeated schema has a member for each field as well.
        if answer is not None or not isinstance(value, dict) or "properties" in value:
            return answer
        wrapped = [inner for part in value.values() if (inner := cls._looked_like(part)) is not None]
        return wrapped[0] if wrapped and all(inner == wrapped[0] for inner in wrapped) else None

    @classmethod
    def _looked_like(cls, value: object) -> dict[str, object] | None:
        """Return an object with one of the fields, or wrap a list of entries; None for other values."""
        if isinstance(value, dict):
            numbered = bool(cls.list_name) and any(_number(key) is not None for key in value)
            return value if numbered or any(key in cls.model_fields for key in value) else None
        if cls.list_name and isinstance(value, list) and value:
            (entry,) = get_args(cls.model_fields[cls.list_name].annotation)
            if all(isinstance(item, dict) and any(key in entry.model_fields for key in item) for item in value):
                return {cls.list_name: value}
        return None

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
        if cls.list_name and cls.list_name not in plain:
            numbered = {number: key for key in plain if (number := _number(key)) is not None}
            if numbered:
                plain[cls.list_name] = [_with_number(plain[key], number) for number, key in sorted(numbered.items())]
        entries = plain.get(cls.list_name)
        if isinstance(entries, list) and all(isinstance(item, Mapping) and "sub_task" not in item for item in entries):
            plain[cls.list_name] = [_with_number(item, number) for number, item in enumerate(entries, start=1)]
        return plain


def _number(key: str) -> int | None:
    digits = key.removeprefix("sub_task_") if key.startswith("sub_task_") else ""
    return int(digits) if digits.isascii() and digits.isdecimal() and len(digits) <= 3 else None


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


def _empty_for_none(value: object) -> object:
    """Replace null, false and their equivalents in words by the empty text."""
    return "" if value is None or value is False or (isinstance(value, str) and is_empty_remark(value)) else value


def _trimmed(longest: int) -> Callable[[str], str]:
    """Return a validator that truncates a text: a long diagnosis is no worse than a short one."""
    return lambda text: text if len(text) <= longest else f"{text[: longest - 3]}..."


Text = Annotated[str, Field(max_length=LONGEST_TEXT), AfterValidator(_printable)]
Sentence = Annotated[str, Field(min_length=1, max_length=LONGEST_TEXT), AfterValidator(_printable)]
MaybeText = Annotated[Text, BeforeValidator(_empty_for_none)]
# A remark may be absent; an empty text says that there is none.
Remark = Annotated[MaybeText, AfterValidator(_trimmed(LONGEST_REMARK))]
Reason = Annotated[Sentence, AfterValidator(_trimmed(LONGEST_REMARK))]
Line = Annotated[
    str, Field(min_length=1, max_length=LONGEST_NAME), AfterValidator(_printable), AfterValidator(_one_line)
]
MaybeLine = Annotated[MaybeText, AfterValidator(_one_line), AfterValidator(_trimmed(LONGEST_NAME))]
Formula = Annotated[str, Field(min_length=1, max_length=LONGEST_FORMULA), AfterValidator(_printable)]
ObjectId = Annotated[str, Field(min_length=1, max_length=LONGEST_NAME), AfterValidator(_printable)]
# An empty text says that there is no such object.
MaybeObjectId = Annotated[
    str, BeforeValidator(_empty_for_none), Field(max_length=LONGEST_NAME), AfterValidator(_printable)
]
# Valid as a name in BDDL texts and of files.
ActivityName = Annotated[
    str,
    BeforeValidator(lambda value: _underscored(value) if isinstance(value, str) else value),
    Field(min_length=1, max_length=LONGEST_NAME, pattern=r"^[A-Za-z][A-Za-z0-9_.\-]*$"),
]
Number = Annotated[int, Field(ge=1, le=MOST_SUBTASKS)]
StepNumber = Annotated[int, Field(ge=1, le=1_000)]
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


_KEPT = ("type", "description", "enum")


def wire_schema(answer: type[Answer]) -> dict[str, object]:
    """Return the JSON schema of an answer for endpoints: no references, unions, optional fields or bounds.

    Bounds are checked when the answer arrives; several endpoints reject a request whose schema has them.
    """
    full = answer.model_json_schema()
    return _flat(full, full.get("$defs", {}))


def _flat(node: Mapping[str, object], known: Mapping[str, Mapping[str, object]]) -> dict[str, object]:
    """Expand the references of a schema; answers nest three levels deep, and none contains itself."""
    reference = node.get("$ref")
    if isinstance(reference, str):
        return _flat(known[reference.rpartition("/")[2]], known)
    written = {key: node[key] for key in _KEPT if key in node}
    items, properties = node.get("items"), node.get("properties")
    if isinstance(items, Mapping):
        written["items"] = _flat(items, known)
    if isinstance(properties, Mapping):
        written["properties"] = {key: _flat(value, known) for key, value in properties.items()}
        written["required"] = list(properties)
        written["additionalProperties"] = False
    if written.get("type") == "object":
        # A docstring is for readers of the code.
        written.pop("description", None)
    return written


_LONGEST_PROBLEM = 240
_OWN_KEYS = ("primitive", "parameters", "parameter")
# Keys whose numbers are no parameters of the motion.
_KNOWN_KEYS = (*_OWN_KEYS, "step", "index", "number", "id")
_NO_NUMBERS: tuple[object, ...] = (None, [], {})


class WrittenAction(Answer):
    """One action: the ID of its primitive and its numbers, which may be omitted for the executor to fill in."""

    primitive: int = Field(description="ID of the primitive, 1 to 21")
    parameters: list[float] = Field(
        max_length=2, description="empty, one number (m or degrees), or two (joint limits), as the table says"
    )

    def action(self) -> Action:
        """Return the action; `verify` checks whether its numbers fit the primitive."""
        numbers = tuple(self.parameters)
        parameter = None if not numbers else numbers[0] if len(numbers) == 1 else (numbers[0], numbers[1])
        return Action(Primitive(self.primitive), parameter)


def _step(item: object) -> object:
    """Convert an action from either of the two forms to the form of the wire."""
    own = isinstance(item, Mapping) and any(key in item for key in _OWN_KEYS)
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


def _own_form(item: Mapping[str, object]) -> object:
    """Convert the wire's form of an action to the paper's form, mistakes included."""
    if "primitive" not in item:
        raise _refused("flow/unknown-primitive", f"the field primitive is missing; got {', '.join(map(repr, item))}")
    primitive = item["primitive"]
    numbers = item.get("parameters", item.get("parameter"))
    if numbers in _NO_NUMBERS:
        # A number under another key would be lost, and a different motion executed.
        astray = [key for key, value in item.items() if key not in _KNOWN_KEYS and not isinstance(value, str | None)]
        if astray:
            raise _refused("flow/parameter", f"numbers stand under parameters, not under {astray[0]!r}")
        return _id(primitive)
    if not isinstance(numbers, list):
        numbers = [numbers]
    return {str(_id(primitive)): numbers[0] if len(numbers) == 1 else numbers}


def _with_id(item: object) -> object:
    if isinstance(item, Mapping) and len(item) == 1:
        ((key, value),) = item.items()
        return _id(key) if value in _NO_NUMBERS else {str(_id(key)): value}
    return _id(item) if isinstance(item, str) else item


def _id(primitive: object) -> object:
    """Return a primitive's ID for its name; anything that is neither becomes a text that can be shown."""
    if isinstance(primitive, str):
        name = "_".join(primitive.upper().split())
        return int(Primitive[name]) if name in Primitive.__members__ else primitive
    return primitive if isinstance(primitive, int) else repr(primitive)


WireStep = Annotated[WrittenAction, BeforeValidator(_step)]
