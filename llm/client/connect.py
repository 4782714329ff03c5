"""`connect` opens a model or a recording by its configuration, such as `openai:gpt-5.2` or `replay:run.jsonl`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from llm.client.budget import Budget, Metered, check_price
from llm.client.local import served
from llm.client.openai import OpenAITransport
from llm.client.profiles import ModelProfile, Price, find_profile, tables
from llm.client.recording import Continued, Recorder, Replay
from llm.client.shared import Shared
from llm.client.transport import Routed, Sampled, Transport
from llm.errors import ModelConfigError

_REPLAY = "replay"
_NOTHING_PAID = Price(input=0.0, output=0.0)  # Recorded replies are not paid for again.


def recording_of(configuration: str) -> tuple[Path | None, str]:
    """Return the recording that a configuration names, and the model that goes on where it ends; empty for none.

    Only `replay:FILE` and `replay:FILE,PROVIDER:MODEL` name a recording.
    """
    provider, _, rest = configuration.strip().partition(":")
    if provider != _REPLAY or not rest:
        return None, configuration
    file, comma, model = rest.rpartition(",")
    goes_on = bool(comma) and model.partition(":")[0] in tables() and ":" in model
    return (Path(file), model) if goes_on else (Path(rest), "")


def is_replay(configuration: str) -> bool:
    """Decide whether a configuration names a recording alone, so that nothing is asked or paid."""
    file, model = recording_of(configuration)
    return file is not None and not model


def replayed(file: Path, *, temperature: float | None = None, seed: int | None = None) -> Metered:
    """Return a transport that answers from a recording alone, whatever its path contains.

    Args:
        file: The recording.
        temperature, seed: Sampling of every request, as when it was recorded.

    Raises:
        CassetteError: It cannot be read.
    """
    transport: Transport = (replay := Replay(file))
    if temperature is not None or seed is not None:
        transport = Sampled(transport, temperature, seed)
    return Metered(transport, name=f"{_REPLAY}:{file}", price=_NOTHING_PAID, warnings=replay.warnings, replays=True)


def connect(
    configuration: str,
    *,
    budget: Budget | None = None,
    record: Path | None = None,
    resume: bool = False,
    same_start: bool = True,
    models: Mapping[int, str] = MappingProxyType({}),
    temperature: float | None = None,
    seed: int | None = None,
    shared: Path | None = None,
    starts: bool = True,
) -> Metered:
    """Return a transport for a configuration, with usage counted in `.usage`; nothing is sent yet.

    `.warnings` states what was skipped in a damaged recording, and what is continued.

    Args:
        configuration: "provider:model", such as "openai:gpt-5.2"; "replay:FILE" for a recorded run; or
            "replay:FILE,provider:model" for one that the model continues where the recording ends.
        budget: Limits of the run; default is none.
        record: A new file into which every exchange is written.
        resume: Continue the file of a run that ended early: its replies are returned first, and not asked again.
        same_start: With `resume`, refuse to ask if the run's first request is not in the file.
        models: Module, 1 to 5, or judge -> configuration of its own model.
        temperature, seed: Sampling of every request; None leaves it to the server. A replay needs the same values.
        shared: File in which processes count what they use together; the budget is then one of all of them.
        starts: Whether the server of a model's file is started; without it, all else is checked and nothing answers.

    Raises:
        ModelConfigError: Provider, model, key, address or library is unknown or missing; or a model takes no
            temperature.
        CassetteError: A recording cannot be read or created.
    """
    if configuration.strip() == f"{_REPLAY}:":
        raise ModelConfigError(configuration, "no recording is named", "Name its file, as in replay:run.jsonl")
    file, model = recording_of(configuration)
    replay = None if file is None else Replay(file)
    profile = find_profile(model) if model or replay is None else None
    profiles = {module: find_profile(name) for module, name in models.items()}
    for one in (profile, *profiles.values()):
        if temperature is not None and one is not None and not one.send_temperature:
            raise ModelConfigError(one.name, "the model takes no temperature", "Leave the temperature out")
    prices = {module: one.price for module, one in profiles.items()}
    if profile is None:
        assert replay is not None
        transport: Transport = replay
    else:
        transport = _live(profile, profiles, starts=starts)
        if shared is not None:
            together, budget = budget or Budget(), None
            check_price(profile.name, together, profile.price, *prices.values())
            name, price = profile.name, profile.price
            transport = Shared(transport, shared, name=name, budget=together, price=price, prices=prices)
        if replay is not None:
            transport = Continued(replay, transport)
    warnings = () if replay is None else replay.warnings
    if record is not None:
        transport = recorder = Recorder(transport, record, resume=resume, same_start=same_start)
        warnings = (*warnings, *recorder.notes)
    if temperature is not None or seed is not None:
        transport = Sampled(transport, temperature, seed)
    return Metered(
        transport,
        name=configuration if profile is None or replay is not None else profile.name,
        budget=budget,
        price=_NOTHING_PAID if profile is None else profile.price,
        prices={} if profile is None else prices,
        warnings=warnings,
        boxes=None if profile is None else profile.boxes,
        replays=profile is None,
    )


def _live(profile: ModelProfile, profiles: Mapping[int, ModelProfile], *, starts: bool) -> Transport:
    """Return a transport to a model, and to those of some modules."""
    others = {module: OpenAITransport(served(one, starts=starts)) for module, one in profiles.items()}
    transport = OpenAITransport(served(profile, starts=starts))
    return Routed(transport, others) if others else transport
