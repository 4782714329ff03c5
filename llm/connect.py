"""From a configuration string to a transport: the one place that knows live models and recordings alike."""

from __future__ import annotations

from pathlib import Path
from threading import Event

from llm.budget import Budget, Metered
from llm.cassette import Recorder, Replay
from llm.errors import ModelConfigError
from llm.model_profile import Price
from llm.openai_transport import OpenAITransport
from llm.profiles import find_profile
from llm.retries import RetryPolicy
from llm.transport import Transport

REPLAY = "replay"


def connect(
    configuration: str,
    *,
    budget: Budget | None = None,
    record: Path | None = None,
    images_folder: Path | None = None,
    cancel: Event | None = None,
    retries: RetryPolicy | None = None,
) -> Metered:
    """Returns what answers requests, with its usage counted in `.usage`; nothing is sent yet.

    Args:
        configuration: "provider:model", such as "openai:gpt-5.2", or "replay:FILE" for a recorded run.
        budget: Limits of the run; default is none.
        record: A new file into which every exchange is written.
        images_folder: Where a recording keeps the pictures; None keeps their hashes only.
        cancel: Setting it ends a request that is under way, and all later ones.
        retries: When failed requests are sent again.

    Raises:
        ModelConfigError: Provider, model, key, address or library is unknown or missing.
        CassetteError: A recording cannot be read or made.
    """
    provider, _, rest = configuration.strip().partition(":")
    transport: Transport
    price: Price | None
    if provider == REPLAY:
        if not rest:
            raise ModelConfigError(configuration, "no recording is named", "Name its file, as in replay:run.jsonl")
        # What was paid for once is not paid for again.
        transport, price = Replay(Path(rest)), Price(0.0, 0.0)
        name = configuration
    else:
        profile = find_profile(configuration)
        transport = OpenAITransport(profile, retries=retries, cancel=cancel)
        price, name = profile.price, profile.name
    if record is not None:
        transport = Recorder(transport, record, images_folder=images_folder)
    return Metered(transport, name=name, budget=budget, price=price)
