"""From a configuration string to a transport: the one place that knows live models and recordings alike."""

from __future__ import annotations

from pathlib import Path
from threading import Event

from llm.errors import ModelConfigError
from llm.wire.budget import Budget, Metered
from llm.wire.cassette import Recorder, Replay
from llm.wire.client import OpenAITransport
from llm.wire.profiles import BoxForm, Price, find_profile
from llm.wire.transport import Transport


def connect(
    configuration: str,
    *,
    budget: Budget | None = None,
    record: Path | None = None,
    resume: bool = False,
    same_start: bool = True,
    cancel: Event | None = None,
) -> Metered:
    """Returns what answers requests, with its usage counted in `.usage`; nothing is sent yet.

    What was left out of a damaged recording, and what is gone on with, is in `.warnings`.

    Args:
        configuration: "provider:model", such as "openai:gpt-5.2", or "replay:FILE" for a recorded run.
        budget: Limits of the run; default is none.
        record: A new file into which every exchange is written.
        resume: Goes on with the file of a run that ended early: its replies are given first, and not asked again.
        same_start: With `resume`, refuses to ask where the run's first request is not in the file.
        cancel: Setting it ends a request that is under way, and all later ones.

    Raises:
        ModelConfigError: Provider, model, key, address or library is unknown or missing.
        CassetteError: A recording cannot be read or made.
    """
    provider, _, rest = configuration.strip().partition(":")
    transport: Transport
    price: Price | None
    boxes: BoxForm | None = None
    warnings: tuple[str, ...] = ()
    if provider == "replay":
        if not rest:
            raise ModelConfigError(configuration, "no recording is named", "Name its file, as in replay:run.jsonl")
        # What was paid for once is not paid for again.
        price, name = Price(input=0.0, output=0.0), configuration
        transport = replay = Replay(Path(rest))
        warnings = replay.warnings
    else:
        profile = find_profile(configuration)
        transport, price, name = OpenAITransport(profile, cancel=cancel), profile.price, profile.name
        boxes = profile.boxes
    if record is not None:
        transport = recorder = Recorder(transport, record, resume=resume, same_start=same_start)
        warnings = (*warnings, *recorder.notes)
    return Metered(transport, name=name, budget=budget, price=price, warnings=warnings, boxes=boxes)
