"""What the models of a run took: a line for each round, and the whole, with what they cost where the price is known."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

from llm.answers.conversation import Round, asker
from llm.wire.budget import Metered


def _untold(line: str) -> None:
    """Tell nobody."""


@dataclass(slots=True)
class Spending:
    """The rounds of a run with their costs; `hear` is given to whoever asks the model.

    Attributes:
        model: Who is asked, with its usage and its price.
        tell: Gets a line for each round, when its answer has been judged.
        rounds: Every round until now.
    """

    model: Metered
    tell: Callable[[str], None] = _untold
    rounds: list[Round] = field(default_factory=list)
    _asked: Counter[int] = field(default_factory=Counter)

    def hear(self, entry: Round) -> None:
        """Keep a round, and tell it."""
        self.rounds.append(entry)
        self._asked[entry.module] += 1
        self.tell(", ".join((f"{asker(entry.module)}, round {self._asked[entry.module]}", *self.numbers(entry))))

    def cost_usd(self, entry: Round) -> float | None:
        """Return what a round costs by list price, in US dollars; None where the price or the tokens are not known."""
        price, tokens = self.model.price, (entry.input_tokens, entry.output_tokens)
        if price is None or tokens[0] is None or tokens[1] is None:
            return None
        return price.cost_usd(tokens[0], tokens[1])

    def numbers(self, entry: Round) -> tuple[str, str, str]:
        """Return a round's seconds, tokens and cost, in words."""
        tokens = "tokens not counted"
        if entry.input_tokens is not None and entry.output_tokens is not None:
            tokens = f"{entry.input_tokens} + {entry.output_tokens} tokens"
        cost_usd = self.cost_usd(entry)
        cost = "price unknown" if self.model.price is None else "cost unknown"
        if cost_usd is not None:
            cost = f"${cost_usd:.4f}"
        if entry.recorded:
            cost = f"{cost}, paid before" if cost_usd else "recorded, not paid again"
        return f"{entry.latency_s:.1f} s", tokens, cost

    def rows(self) -> list[tuple[str, str, str, str, str]]:
        """Return who asked, the number of the round, and its numbers, a row for each round."""
        asked = Counter[int]()
        rows = []
        for entry in self.rounds:
            asked[entry.module] += 1
            rows.append((asker(entry.module), str(asked[entry.module]), *self.numbers(entry)))
        return rows

    def total(self) -> str:
        """Return the whole in one line."""
        price = self.model.price
        dated = f" (list prices of {price.date})" if price is not None and price.date else ""
        return f"{self.model.name}: {self.model.usage.summary()}{dated}"

    def to_json(self) -> dict[str, object]:
        """Return the whole and its rounds as JSON values."""
        price = self.model.price
        return {
            "model": self.model.name,
            "price": None if price is None else price.model_dump(),
            **self.model.usage.record(),
            "rounds": [
                {
                    "asked_by": who,
                    "round": int(number),
                    "seconds": entry.latency_s,
                    "input_tokens": entry.input_tokens,
                    "output_tokens": entry.output_tokens,
                    "cost_usd": self.cost_usd(entry),
                    "recorded": entry.recorded,
                    "accepted": entry.accepted,
                }
                for (who, number, *_), entry in zip(self.rows(), self.rounds, strict=True)
            ],
        }
