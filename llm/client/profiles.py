"""Profiles of models, by configuration strings such as "openai:gpt-5.2".

Every difference between providers is a setting in profiles.toml, or in a user's file that overrides it. The
client code has no cases for providers.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from functools import cache
from importlib import resources
from typing import Annotated, Any, Literal, TypeAlias, get_args
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from bddl.files import read_bounded_text
from llm.client.transport import MODES, Mode
from llm.errors import ModelConfigError

# Environment variable that names a file of the form of profiles.toml; its entries override the built-in ones.
OWN_PROFILES = "SCENE2DEMO_PROFILES"
_MORE = f"Others go into a file that the environment variable {OWN_PROFILES} names, or by openai-compatible:NAME"
_ADDRESS_ADVICE = "It looks like http://127.0.0.1:8000/v1"

Table: TypeAlias = dict[str, Any]
BoxForm = Literal[
    "thousandths xyxy",
    "thousandths yxyx",
    "thousandths xywh",
    "pixels xyxy",
    "pixels yxyx",
    "pixels xywh",
    "shares xyxy",
    "shares yxyx",
    "shares xywh",
]
"""Unit and order of the four numbers of a box in a model's answer."""


class Price(BaseModel):
    """List price in US dollars per million tokens.

    Attributes:
        input, output: Price of requests and of replies.
        date: Date of the price list; empty if not given.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)
    input: float = Field(ge=0)
    output: float = Field(ge=0)
    date: Annotated[str, Field(max_length=40)] = ""

    def cost_usd(self, input_tokens: int, output_tokens: int) -> float:
        """Return the cost of these tokens [US dollars]."""
        return (input_tokens * self.input + output_tokens * self.output) / 1e6


class Settings(BaseModel):
    """Fields of a table in a file of profiles; profiles.toml explains each of them.

    A description states the expected value, for messages.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)
    base_url: str = ""
    base_url_variable: str = ""
    key_variable: str = ""
    key_required: bool = True
    mode: Mode = Field("plain", description=f"one of {', '.join(MODES)}")
    strict: bool = False
    bounds: bool = False
    serve: bool = False
    system_role: Literal["system", "user"] = Field("system", description="one of system, user")
    max_images: int | None = Field(None, ge=0, description="a number, 0 or above")
    stream: bool = False
    timeout_s: float = Field(120.0, gt=0, description="a number of seconds above 0")
    max_tokens_field: Literal["max_tokens", "max_completion_tokens"] = Field(
        "max_tokens", description="one of max_tokens, max_completion_tokens"
    )
    max_tokens: int | None = Field(None, ge=1, description="a number of tokens, 1 or above")
    send_temperature: bool = True
    account_headers: bool = False
    any_model: bool = False
    boxes: BoxForm = Field("thousandths xyxy", description=f"one of {', '.join(get_args(BoxForm))}")
    extra_body: dict[str, object] = Field({}, description="a table")
    price: Price | None = Field(None, description="{ input = DOLLARS, output = DOLLARS } per million tokens")


class _ProviderTable(Settings):
    models: dict[str, Settings] = {}


_FILE = TypeAdapter(dict[str, _ProviderTable])


class ModelProfile(Settings):
    """Settings of one model.

    Attributes:
        provider: The part of the configuration string before the colon.
        model: The part after it, which is the model's name at the server.
    """

    provider: str
    model: str

    @property
    def name(self) -> str:
        """The configuration string."""
        return f"{self.provider}:{self.model}"

    def address(self, environment: Mapping[str, str] = os.environ) -> str:
        """Return the endpoint's address: from the environment, else from the profile.

        Raises:
            ModelConfigError: There is none, it is no http(s) address, or it contains a password.
        """
        address = environment.get(self.base_url_variable, "").strip() if self.base_url_variable else ""
        address = address or self.base_url
        variable = self.base_url_variable or "base_url"
        if not address:
            advice = f"Set the environment variable {variable}, for example to http://127.0.0.1:8000/v1"
            raise ModelConfigError(self.name, "the server's address is not set", advice)
        try:
            parts = urlsplit(address)
            usable = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
        except ValueError:
            raise ModelConfigError(self.name, f"{variable} is no address", _ADDRESS_ADVICE) from None
        if parts.username or parts.password:
            # The address itself is omitted: it contains the secret.
            where = f"Put the key into {self.key_variable}" if self.key_variable else "Leave them out"
            raise ModelConfigError(self.name, f"{variable} holds a user name or password", where)
        if not usable:
            raise ModelConfigError(self.name, f"{variable} is {address[:80]!r}, no http address", _ADDRESS_ADVICE)
        return address

    def key(self, environment: Mapping[str, str] = os.environ) -> str | None:
        """Return the key from the environment, or None if the server needs none.

        Raises:
            ModelConfigError: The variable is unset or empty; the message names it and never contains a value.
        """
        value = environment.get(self.key_variable, "").strip() if self.key_variable else ""
        variable = f"the environment variable {self.key_variable}"
        if not value and self.key_required:
            raise ModelConfigError(self.name, f"{variable} is not set", "It holds the provider's key")
        if not value.isascii() or not value.isprintable() or " " in value:
            advice = "Copy the key again, without quotes and line breaks"
            raise ModelConfigError(self.name, f"{variable} holds characters that no key has", advice)
        return value or None


def find_profile(configuration: str) -> ModelProfile:
    """Return the profile of a model, such as "gemini:gemini-3-flash-preview" or "ollama:qwen3-vl".

    Raises:
        ModelConfigError: The provider or the model is unknown, or the file of profiles is faulty.
    """
    known = tables()
    provider, _, model = configuration.strip().partition(":")
    table = dict(known.get(provider, {}))
    models: Table = table.pop("models", {})
    if not table or not model or (model not in models and not table.get("any_model", False)):
        raise _unknown(configuration, known)
    return ModelProfile(provider=provider, model=model, **(table | models.get(model, {})))


def listed(known: Mapping[str, Table]) -> tuple[str, ...]:
    """Return every configuration in the tables; with `any_model` others work as well."""
    return tuple(f"{provider}:{model}" for provider, table in known.items() for model in table.get("models", {}))


def _unknown(configuration: str, known: dict[str, Table]) -> ModelConfigError:
    shown = " ".join(configuration.split())[:80] or "(no model)"
    provider, colon, model = shown.partition(":")
    names = listed(known)
    legal = [f"{name}:" for name in known]
    if not colon:
        problem = "a model is named provider:model"
        tails = {name.partition(":")[2]: name for name in names}
        near = [tails[tail] for tail in get_close_matches(shown, tails, n=3, cutoff=0.7)]
        near = near or [f"{name}:" for name in get_close_matches(shown, known, n=1)]
    elif provider not in known:
        problem = f"no provider is named {provider!r}"
        near = [f"{name}:{model}" for name in get_close_matches(provider, known, n=1)]
    else:
        legal = [name for name in names if name.startswith(f"{provider}:")]
        problem = f"{provider} has no profile for {model!r}" if model else f"no model of {provider} is named"
        near = get_close_matches(shown, legal, n=3, cutoff=0.7) if model else []
    advice = f"Did you mean {' or '.join(near)}? " if near else ""
    advice += f"Listed: {', '.join(legal)}. {_MORE}" if legal else "Name one, such as openai-compatible:my-model"
    return ModelConfigError(shown, problem, advice, near=near, known=names)


def tables() -> dict[str, Table]:
    """Return provider -> settings, with the models' settings under "models"; the user's file has priority.

    Raises:
        ModelConfigError: The file cannot be read, or a setting in it is unknown or of the wrong kind.
    """
    named = os.environ.get(OWN_PROFILES)
    if not named:
        return _built_in()
    try:
        text = read_bounded_text(named)
    except (OSError, UnicodeDecodeError) as error:
        raise ModelConfigError(named, f"the file of profiles cannot be read: {error}") from error
    merged = dict(_built_in())
    for provider, table in _checked(text, named).items():
        below = merged.get(provider, {})
        merged[provider] = below | table | {"models": {**below.get("models", {}), **table.get("models", {})}}
    return merged


@cache
def _built_in() -> dict[str, Table]:
    return _checked((resources.files("llm.client") / "profiles.toml").read_text(encoding="utf-8"), "profiles.toml")


def _checked(text: str, file: str) -> dict[str, Table]:
    try:
        found = tomllib.loads(text)
        _FILE.validate_python(found)
    except tomllib.TOMLDecodeError as error:
        raise ModelConfigError(file, f"no TOML: {error}") from error
    except RecursionError:
        raise ModelConfigError(file, "no TOML of profiles: it is nested too deeply") from None
    except ValidationError as problem:
        raise _faulty(*problem.errors()[0]["loc"], found=problem.errors()[0]["input"], file=file) from None
    return found


def _faulty(provider: int | str, *place: int | str, found: object, file: str) -> ModelConfigError:
    where = f"[{provider}]"
    if place[:1] == ("models",) and len(place) > 1:
        where, place = f'[{provider}.models."{place[1]}"]', place[2:]
    if not place:
        return ModelConfigError(file, f"{where} is a table of settings")
    name = str(place[0])
    if name == "models":
        return ModelConfigError(file, f"{where} is a table of settings, with a table of models")
    field = Settings.model_fields.get(name)
    if field is None:
        near = get_close_matches(name, Settings.model_fields, n=1)
        advice = f"Did you mean {near[0]}? " if near else ""
        advice += f"Settings are {', '.join(Settings.model_fields)}"
        return ModelConfigError(file, f"{where} has an unknown setting {name!r}", advice, near=near)
    wanted = field.description or ("true or false" if field.annotation is bool else "a text")
    return ModelConfigError(file, f"{where} {name} is {wanted}, not {str(found)[:60]!r}")
