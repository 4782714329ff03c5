"""A budget that several processes share: one file says what their models have used, and each process adds to it.

Requests are counted below a recording, so that recorded replies use up nothing. A reply is counted once it is there,
and before it is recorded. A request whose process is killed before is not counted, though its server may charge it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import IO

from bddl.files import open_plain
from llm.client.budget import Budget, Usage, late_reply, send_within, spent_limit
from llm.client.profiles import Price
from llm.client.transport import ChatReply, ChatRequest, Transport
from llm.errors import BudgetSpent, CassetteError

try:
    import fcntl
except ImportError:  # Windows has none.
    fcntl = None  # type: ignore[assignment]

_NAMES = frozenset(item.name for item in fields(Usage))


class Shared:
    """Forward requests while all processes together are within a budget, and count them in a file.

    The limit in time is on the sum of all waiting. Each process may exceed a limit by the request that it has sent.
    """

    def __init__(
        self,
        transport: Transport,
        file: Path,
        *,
        name: str,
        budget: Budget,
        price: Price | None,
        prices: Mapping[int, Price | None] = MappingProxyType({}),
    ) -> None:
        """Set up; nothing is sent.

        Args:
            transport: Transport that answers and is paid.
            file: File of the usage; created with the first request.
            name: The configuration string.
            budget: Limits of all processes together.
            price: Price of tokens; None if unknown.
            prices: Module -> price of its own model, where it has one.
        """
        self._transport, self._file, self._name, self._budget = transport, file, name, budget
        self._price, self._prices = price, prices

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return the transport's reply.

        Raises:
            BudgetSpent: A limit is reached, or the remaining time ran out.
            ModelError: As the transport does.
            CassetteError: The file cannot be read or written.
        """
        with self._updated() as used:
            problem = spent_limit(used, self._budget)
        if problem is not None:
            raise self._spent(problem, used)
        limit_s = self._budget.time_s
        left_s = None if limit_s is None else limit_s - used.waited_s
        price = self._prices.get(request.module, self._price)
        return send_within(
            self._transport,
            request,
            left_s,
            count=lambda reply, attempts, waited_s: self._add(_counted(reply, price, attempts, waited_s)),
            ran_out=lambda: self._spent(late_reply(self._budget), used),
        )

    def _spent(self, problem: str, used: Usage) -> BudgetSpent:
        return BudgetSpent(self._name, problem, f"Used by all together: {used.summary()}")

    def _add(self, more: Usage) -> None:
        with self._updated(more):
            pass

    @contextmanager
    def _updated(self, more: Usage | None = None) -> Iterator[Usage]:
        """Provide the usage of all processes, with a part that is added to it."""
        with _usable(self._file, self._name):
            self._file.parent.mkdir(parents=True, exist_ok=True)
            with os.fdopen(open_plain(self._file, os.O_RDWR | os.O_CREAT), "r+", encoding="utf-8") as stream:
                if fcntl is not None:
                    with suppress(OSError):  # A disk without locks.
                        fcntl.flock(stream, fcntl.LOCK_EX)
                used = _read(stream)
                if more is not None:
                    used = _sum(used, more)
                    stream.seek(0)
                    # Padded, so that a shorter text leaves nothing of a longer one.
                    stream.write(json.dumps(used.record()).ljust(_WIDTH) + "\n")
                    stream.flush()
                    os.fsync(stream.fileno())
        yield used


@contextmanager
def _usable(file: Path, name: str) -> Iterator[None]:
    """Raise CassetteError of a model where a file of usage cannot be read or written, or says something else."""
    try:
        yield
    except OSError as error:
        problem = f"the usage cannot be counted in {file}: {error.strerror or error}"
        raise CassetteError(name, problem, "Check the folder and the disk") from error
    except (ValueError, RecursionError) as error:
        problem = f"{file} does not say what was used: {error}"
        raise CassetteError(name, problem, "Remove it, and limits count from nothing again") from None


_WIDTH = 400


def usage_in(file: Path, name: str) -> Usage:
    """Return the usage that a file of a shared budget has; nothing was used where there is no file.

    Args:
        file: The file.
        name: The configuration string, for a message.

    Raises:
        CassetteError: It cannot be read, or says something else.
    """
    with _usable(file, name):
        try:
            with os.fdopen(open_plain(file, os.O_RDONLY), encoding="utf-8") as stream:
                return _read(stream)
        except (FileNotFoundError, NotADirectoryError):
            return Usage(cost_usd=0.0)


def _read(stream: IO[str]) -> Usage:
    text = stream.read(10 * _WIDTH)
    if not text.strip():
        return Usage(cost_usd=0.0)
    found = json.loads(text)
    if not isinstance(found, dict) or found.keys() != _NAMES:
        raise ValueError(f"expected {', '.join(sorted(_NAMES))}")
    for name, value in found.items():
        unknown = value is None and name == "cost_usd"
        if not unknown and (isinstance(value, bool) or not isinstance(value, int | float) or value < 0):
            raise ValueError(f"{name} is {value!r}")
    return Usage(**found)


def _counted(reply: ChatReply | None, price: Price | None, attempts: int, waited_s: float) -> Usage:
    """Return the usage of one request."""
    used = Usage(attempts, attempts - (reply is not None), cost_usd=0.0, waited_s=waited_s, elapsed_s=waited_s)
    if reply is None:
        return used
    tokens = reply.input_tokens or 0, reply.output_tokens or 0
    uncounted = int(reply.input_tokens is None or reply.output_tokens is None)
    cost_usd = None if price is None else price.cost_usd(*tokens)
    return replace(used, input_tokens=tokens[0], output_tokens=tokens[1], uncounted=uncounted, cost_usd=cost_usd)


def _sum(one: Usage, other: Usage) -> Usage:
    """Return the sum of two usages; a cost that is unknown once stays so."""
    counts = {name: getattr(one, name) + getattr(other, name) for name in _NAMES - {"cost_usd"}}
    known = one.cost_usd is not None and other.cost_usd is not None
    return Usage(**counts, cost_usd=(one.cost_usd or 0.0) + (other.cost_usd or 0.0) if known else None)
