"""The words of a query that the planner does not know: a query that has one is refused, and the words are named."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from llm.errors import RefusalCode
from llm.offline.names import Names
from llm.offline.refusal import Refusal
from llm.offline.words import Word
from llm.request import enumeration

# What a refusal can be about where words are not known; any other one rests on words that were taken for names.
_SAYING: tuple[RefusalCode, ...] = ("unknown-object", "unknown-action", "not-understood", "too-long", "empty")
_MOST_SHOWN = 4
_LONGEST_SHOWN = 60


def strangers(tokens: Sequence[Word], names: Names) -> tuple[str, ...]:
    """Returns the runs of words that are no part of any name, of the scene's or of the lexicon's, each once."""
    runs = groupby(tokens, key=lambda token: token.terminal == "WORD" and not names.knows(token.text))
    return tuple(dict.fromkeys(" ".join(token.text for token in run) for strange, run in runs if strange))


def refusal_of(strange: Sequence[str], names: Names, other: Refusal | None) -> Refusal:
    """Returns the refusal that names the words that nobody knows.

    Args:
        strange: Those words, at least one.
        names: What the scene's objects are called.
        other: The refusal that reading the query has led to all the same.
    """
    words = [word for run in strange for word in run.split()]
    strange = [run if len(run) <= _LONGEST_SHOWN else f"{run[:_LONGEST_SHOWN]}..." for run in strange]
    said = [f'"{run}"' for run in strange[:_MOST_SHOWN]]
    said += [f"{len(strange) - _MOST_SHOWN} more"] if len(strange) > _MOST_SHOWN else []
    code = other.code if other is not None and other.code in _SAYING else "not-understood"
    if any(word in names.lexicon.foreign or (word.isalpha() and not word.isascii()) for word in words):
        problem = f"the offline planner reads English only, and does not know {enumeration(said)}"
        return Refusal(code, f"{problem}; a language model may know other languages")
    if names.lexicon.people.issuperset(words):
        problem = f"nothing can be handed to {enumeration(said)}; ask to pick it up, or say where it shall go"
        return Refusal("not-understood", problem)
    if not any(map(str.isalnum, "".join(words))):
        code = "not-understood"
    if code == "unknown-object":
        problem = f"nothing in {names.scene.name} is called {' or '.join(said)}{names.meant(*strange[:_MOST_SHOWN])}"
    elif other is not None and code == other.code and code != "not-understood":
        problem = f"it does not know {enumeration(said)}; {other.problem}"
    else:
        problem = f"it does not know {enumeration(said)}"
    scene = other.scene if other is not None and code == other.code else ()
    return Refusal(code, problem, scene=scene)
