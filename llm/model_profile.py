"""The profile of one model: where its server is, where its key is, and what it can take."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal
from urllib.parse import urlsplit

from llm.errors import ModelConfigError
from llm.transport import Mode

_ADDRESS_ADVICE = "It looks like http://127.0.0.1:8000/v1"


@dataclass(frozen=True, slots=True)
class Price:
    """List price in US dollars per million tokens."""

    input: float
    output: float

    def cost_usd(self, input_tokens: int, output_tokens: int) -> float:
        """Returns what so many tokens cost, in US dollars."""
        return (input_tokens * self.input + output_tokens * self.output) / 1e6


@dataclass(frozen=True, slots=True)
class ModelProfile:
    """How to talk to one model; profiles.toml says what each field means.

    Attributes:
        provider: The part of the configuration string before the colon.
        model: The part after it, which is the model's name at the server.
    """

    provider: str
    model: str
    base_url: str = ""
    base_url_variable: str = ""
    key_variable: str = ""
    key_required: bool = True
    mode: Mode = "plain"
    system_role: Literal["system", "user"] = "system"
    max_images: int | None = None
    stream: bool = False
    timeout_s: float = 120.0
    max_tokens_field: str = "max_tokens"
    send_temperature: bool = True
    account_headers: bool = False
    any_model: bool = False
    extra_body: Mapping[str, object] = field(default_factory=dict)
    price: Price | None = None

    @property
    def name(self) -> str:
        """The configuration string."""
        return f"{self.provider}:{self.model}"

    def address(self, environment: Mapping[str, str] = os.environ) -> str:
        """Returns the endpoint's address: from the environment, else from the profile.

        Raises:
            ModelConfigError: There is none, or it is no http(s) address, or it holds a password.
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
            # The address itself is left out: it holds the secret.
            where = f"Put the key into {self.key_variable}" if self.key_variable else "Leave them out"
            raise ModelConfigError(self.name, f"{variable} holds a user name or password", where)
        if not usable:
            raise ModelConfigError(self.name, f"{variable} is {address[:80]!r}, no http address", _ADDRESS_ADVICE)
        return address

    def key(self, environment: Mapping[str, str] = os.environ) -> str | None:
        """Returns the key from the environment, or None where the server needs none.

        Raises:
            ModelConfigError: The variable is not set or empty; the message names it, and never holds a value.
        """
        value = environment.get(self.key_variable, "").strip() if self.key_variable else ""
        if not value and self.key_required:
            raise ModelConfigError(
                self.name, f"the environment variable {self.key_variable} is not set", "It holds the provider's key"
            )
        if not value.isascii() or not value.isprintable() or " " in value:
            problem = f"the environment variable {self.key_variable} holds characters that no key has"
            raise ModelConfigError(self.name, problem, "Copy the key again, without quotes and line breaks")
        return value or None
