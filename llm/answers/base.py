"""What all answers have in common: strict types, bounded texts, and a flat schema for the wire.

Every field is asked for, has one type, and is a text, a number, a list or an object: some endpoints reject unions,
optional fields and references. A field that is not needed may be missing all the same. What a model adds beside the
fields is ignored, and so has no effect on anything.
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
        """Returns the answer that a JSON value looks like or wraps, None without one.

        It is an object with one of the fields, the bare list of numbered entries, or an object around one of these.
        """
        answer = cls._looked_like(value)
        # A schema that is repeated has a member for each field as well.
        if answer is not None or not isinstance(value, dict) or "properties" in value:
            return answer
        wrapped = [inner for part in value.values() if (inner := cls._looked_like(part)) is not None]
        return wrapped[0] if wrapped and all(inner == wrapped[0] for inner in wrapped) else None

    @classmethod
    def _looked_like(cls, value: object) -> dict[str, object] | None:
        """Returns an object that has one of the fields, or the one around a list of entries; None for other values."""
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
        """Reads the paper's numbered subtasks, and says of a missing field which one it may have been meant by."""
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
        """Returns an object in the form asked for: numbered subtasks in a list, by their order where none says it."""
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
    """Returns a text, or refuses, for pydantic, one with control characters besides some."""
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
    """Returns the empty text for null, for false, and for the words that models write for it."""
    return "" if value is None or value is False or (isinstance(value, str) and says_nothing(value)) else value


def _trimmed(longest: int) -> Callable[[str], str]:
    """Returns what shortens a text to so many characters: a long diagnosis is no worse than a short one."""
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
# What every BDDL text and every file can be called.
ActivityName = Annotated[
    str,
    BeforeValidator(lambda value: _underscored(value) if isinstance(value, str) else value),
    Field(min_length=1, max_length=LONGEST_NAME, pattern=r"^[A-Za-z][A-Za-z0-9_.\-]*$"),
]
Number = Annotated[int, Field(ge=1, le=MOST_SUBTASKS)]
StepNumber = Annotated[int, Field(ge=1, le=1_000)]
# What asks for an integer on the wire, and may be missing.
_INTEGER = WithJsonSchema({"type": "integer"})
MaybeNumber = Annotated[Number | None, _INTEGER]
MaybeStepNumber = Annotated[StepNumber | None, _INTEGER]


class SubtaskAnswer(Answer):
    """What an answer says of one subtask."""

    sub_task: Number = Field(description="number of the subtask")


_NONE = frozenset({"", "null", "none", "nil", "n/a", "not applicable", "-", "–", "—"})
_DENYING = frozenset({"no", "none", "nothing", "without"})


def _words(listed: str) -> frozenset[str]:
    return frozenset(listed.split())


# What is good news when there is none of it ...
_BAD = _words(
    "anomaly anomalies abnormality abnormalities irregularity irregularities deviation deviations problem problems "
    "issue issues fault faults error errors collision collisions anomalous abnormal unusual unexpected unintended "
    "undesired unwanted wrong report"
)
# ... and what may stand around it without changing that.
_AROUND = _words(
    "there is are was were has have been be observed detected seen found noted noticed visible identified apparent "
    "evident obvious present reported occurred during in at of to for with the this that a any all or and other "
    "step action motion movement movements behavior behaviour event events contact contacts"
)
_WORD = re.compile(r"[a-z]+")
_LONGEST = 200


def says_nothing(text: str) -> bool:
    """Decides whether a text only says that there is nothing to say, such as "None" or "No anomalies observed."

    Such texts stand where an empty one was asked for; read as remarks they would turn into faults and refusals. Only
    words of which no other meaning can be made are read so: "No contact was made" is a remark.
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
    """Decides whether a text begins like one that says that there is nothing to say."""
    words = _WORD.findall(text[:_LONGEST].lower())
    return bool(words) and words[0] in (*_DENYING, "not")


_KEPT = ("type", "description", "enum")


def wire_schema(answer: type[Answer]) -> dict[str, object]:
    """Returns the JSON schema of an answer as endpoints take it: no references, unions, optional fields or bounds.

    The bounds are checked here when the answer arrives; several endpoints reject a request whose schema states them.
    """
    full = answer.model_json_schema()
    return _flat(full, full.get("$defs", {}))


def _flat(node: Mapping[str, object], known: Mapping[str, Mapping[str, object]]) -> dict[str, object]:
    """Returns a schema with its references written out; answers nest three levels deep, and none holds itself."""
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
