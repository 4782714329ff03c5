"""A supervisor's answers that the graph did not let through, in words: what was to be run, and what is wrong."""

from __future__ import annotations

import json
from collections.abc import Sequence

from pydantic import ValidationError

from llm.answers.revision import RevisedFlow
from llm.conversation import Round
from llm.evolution.telling import one_line
from llm.extract import extract
from llm.findings import errors_of
from oag import Diagnostic, flow_to_json

_MOST_FINDINGS = 3


def refusals(rounds: Sequence[Round]) -> tuple[str, ...]:
    """Returns the answers among some rounds that could not be used, a line each, in their order.

    What was asked about once because of warnings alone, and may have been taken then, is none of them.

    Args:
        rounds: Questions to a supervisor, with what came back.
    """
    return tuple(f"{_asked_for(entry)}: {_wrong(entry)}" for entry in rounds if errors_of(entry.findings))


def _asked_for(entry: Round) -> str:
    """Returns the flow of a reply, or, where there is none to be read, how it begins."""
    found = extract(entry.reply, RevisedFlow.found_in, cut_off=entry.finish_reason == "length")
    if not isinstance(found, Diagnostic):
        try:
            return json.dumps(flow_to_json(RevisedFlow.model_validate(found).flow))
        except (ValidationError, RecursionError):
            pass
    return f"an answer without a flow that can be read ({one_line(entry.reply, 60)})"


def _wrong(entry: Round) -> str:
    errors = errors_of(entry.findings)
    said = [f"{found.code}: {found.message}" for found in errors[:_MOST_FINDINGS]]
    more = len(errors) - len(said)
    return one_line("; ".join([*said, *([f"and {more} more"] if more else [])]))
