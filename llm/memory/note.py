"""A note of one correction: what failed, where, what changed it into a success, and how often that was so.

Kept as Markdown with a front part in TOML; only the front part counts, the text below it is for people.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass
from typing import Literal, get_args

from oag import ActionFlow, Primitive, flow_to_json

SCHEMA = "scene2demo-skill/1"
MOST_EVIDENCE = 200
LONGEST_LESSON = 600
PROVEN = 2
"""In how many episodes a correction has to have helped before it is tried ahead of what measurements call for."""
Kind = Literal["open", "close", "pick", "place", "other"]
KINDS: tuple[Kind, ...] = get_args(Kind)
Outcome = Literal["succeeded", "failed"]
_NAME_WORDS = 6


@dataclass(frozen=True, slots=True)
class Evidence:
    """One time that a correction was run.

    Attributes:
        task: The task's name.
        seed: The episode's seed; None when it had none.
        outcome: Whether the subtask's goal was reached with it.
        revisions: How many revisions the subtask had until then.
    """

    task: str
    seed: int | None
    outcome: Outcome
    revisions: int = 1


@dataclass(frozen=True, slots=True)
class Note:
    """One correction.

    Attributes:
        cause: Root cause in a few words, as the search over measurements names it, or as a model did.
        primitive: What was done at the step that it lies in.
        kind: What the subtask was about.
        target: Category of its target.
        support: Category of where the target was taken from or put; empty for none.
        before: The flow that failed.
        after: The flow that succeeded.
        lesson: Why it was changed so, in a few sentences.
        evidence: When it was run.
    """

    cause: str
    primitive: Primitive
    kind: Kind
    target: str
    support: str
    before: ActionFlow
    after: ActionFlow
    lesson: str = ""
    evidence: tuple[Evidence, ...] = ()

    @property
    def name(self) -> str:
        """What it is called, and its file: words of the cause, and a digest of everything but lesson and evidence."""
        words = re.findall(r"[a-z0-9]+", f"{self.kind} {self.target} {self.cause}".lower().replace("_", " "))
        flows = [flow_to_json(self.before), flow_to_json(self.after)]
        key = json.dumps([self.cause, self.primitive.name, self.kind, self.target, self.support, *flows])
        digest = hashlib.sha256(key.encode()).hexdigest()[:8]
        return "-".join((*(word[:20] for word in words[:_NAME_WORDS]), digest))

    @property
    def successes(self) -> int:
        """How often it helped."""
        return sum(entry.outcome == "succeeded" for entry in self.evidence)

    @property
    def proven(self) -> bool:
        """Whether it helped in more than one episode: an offset that a single one had is no skill."""
        return self.successes >= PROVEN

    @property
    def rate(self) -> float:
        """How often it helped, of how often it was run, with one of each added, so that one case is not certainty."""
        return (self.successes + 1) / (len(self.evidence) + 2)

    def line(self) -> str:
        """Returns the note on one line, for a model."""
        place = f", {self.support}" if self.support else ""
        return (
            f"{self.kind} {self.target}{place}: at {self.primitive.name}, {self.cause}. "
            f"{json.dumps(flow_to_json(self.before))} failed, {json.dumps(flow_to_json(self.after))} "
            f"worked in {self.successes} of {len(self.evidence)} runs. {self.lesson}"
        )
