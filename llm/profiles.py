"""Finds the profile of a model by its configuration string, such as "openai:gpt-5.2".

Everything that differs between providers is a setting in profiles.toml, so the code that talks to them has no cases.
"""

from __future__ import annotations

from difflib import get_close_matches
from pathlib import Path

from llm.errors import ModelConfigError
from llm.model_profile import ModelProfile, Price
from llm.profile_tables import OWN_PROFILES, Table, tables

_MORE = f"Others go into a file that the environment variable {OWN_PROFILES} names, or by openai-compatible:NAME"


def find_profile(configuration: str, *, own: Path | None = None) -> ModelProfile:
    """Returns the profile of a model.

    Args:
        configuration: "provider:model", such as "gemini:gemini-3-flash-preview" or "ollama:qwen3-vl".
        own: A file of profiles that come before the built-in ones; default is what SCENE2DEMO_PROFILES names, if set.

    Raises:
        ModelConfigError: The provider or the model is unknown, or a file of profiles is faulty.
    """
    known = tables(own)
    provider, _, model = configuration.strip().partition(":")
    table = dict(known.get(provider, {}))
    models: Table = table.pop("models", {})
    if not table or not model or (model not in models and not table.get("any_model", False)):
        raise _unknown(configuration, known)
    settings = table | models.get(model, {})
    if "price" in settings:
        settings["price"] = Price(**settings["price"])
    return ModelProfile(provider, model, **settings)


def configurations(*, own: Path | None = None) -> tuple[str, ...]:
    """Returns every configuration that is listed; where `any_model` holds, others work as well."""
    return _listed(tables(own))


def _listed(known: dict[str, Table]) -> tuple[str, ...]:
    """Returns the configuration strings of all models in the tables."""
    return tuple(f"{provider}:{model}" for provider, table in known.items() for model in table.get("models", {}))


def _unknown(configuration: str, known: dict[str, Table]) -> ModelConfigError:
    """Returns the error for a configuration without a profile: what is wrong, what is near, what there is."""
    shown = " ".join(configuration.split())[:80] or "(no model)"
    provider, colon, model = shown.partition(":")
    listed = _listed(known)
    if not colon:
        problem = "a model is named provider:model"
        tails = {name.partition(":")[2]: name for name in listed}
        near = [tails[tail] for tail in get_close_matches(shown, tails, n=3, cutoff=0.7)]
        near = near or [f"{name}:" for name in get_close_matches(shown, known, n=1)]
        legal = [f"{name}:" for name in known]
    elif provider not in known:
        problem = f"no provider is named {provider!r}"
        near = [f"{name}:{model}" for name in get_close_matches(provider, known, n=1)]
        legal = [f"{name}:" for name in known]
    else:
        legal = [name for name in listed if name.startswith(f"{provider}:")]
        problem = f"{provider} has no profile for {model!r}" if model else f"no model of {provider} is named"
        near = get_close_matches(shown, legal, n=3, cutoff=0.7) if model else []
    advice = f"Did you mean {' or '.join(near)}? " if near else ""
    advice += f"Listed: {', '.join(legal)}. {_MORE}" if legal else "Name one, such as openai-compatible:my-model"
    return ModelConfigError(shown, problem, advice, near=near, known=listed)
