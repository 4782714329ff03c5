"""What a model sees in self-evolution, varied: subsets of the cameras, or how many steps it looks back.

Source: the paper's ablations over camera views and over p_1. Every setting runs the same scenes with the same seeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from executor.evolution.record import Evolution
from executor.pictures.cameras import VIEWS
from llm.answers.conversation import Conversation
from oag import clopper_pearson

LOOK_BACKS = (0, 1, 2)


@dataclass(frozen=True, slots=True)
class AblationSetting:
    """What a model is shown.

    Attributes:
        views: The paper's C.
        look_back: The paper's p_1.
    """

    views: tuple[str, ...]
    look_back: int

    @property
    def letters(self) -> str:
        """The cameras as the paper writes them, such as "G,H,W"."""
        return ",".join(view[0].upper() for view in self.views)


def view_settings(look_back: int) -> tuple[AblationSetting, ...]:
    """Returns a setting for each subset of the cameras, the small ones first."""
    subsets = (subset for count in range(1, len(VIEWS) + 1) for subset in combinations(VIEWS, count))
    return tuple(AblationSetting(subset, look_back) for subset in subsets)


def look_back_settings(views: tuple[str, ...]) -> tuple[AblationSetting, ...]:
    """Returns a setting for each look-back window."""
    return tuple(AblationSetting(views, look_back) for look_back in LOOK_BACKS)


@dataclass(frozen=True, slots=True)
class AblationRow:
    """Result of one setting.

    Attributes:
        setting: Cameras and look-back.
        trials: Episodes.
        before: How many succeeded without any revision.
        after: How many succeeded in the end.
        revisions: Of the episodes that succeeded, each one's number of revisions.
        questions: Requests to the model.
        input_tokens, output_tokens: As the server counted them.
        latencies_s: How long each reply took.
        stopped: Why the model was asked nothing more, where that was so.
    """

    setting: AblationSetting
    trials: int
    before: int
    after: int
    revisions: tuple[int, ...]
    questions: int
    input_tokens: int
    output_tokens: int
    latencies_s: tuple[float, ...]
    stopped: str = ""

    @property
    def mean_revisions(self) -> float | None:
        """Mean number of revisions of the episodes that succeeded; None without any."""
        return sum(self.revisions) / len(self.revisions) if self.revisions else None

    @property
    def mean_latency_s(self) -> float | None:
        """Mean time of a reply; None without any."""
        return sum(self.latencies_s) / len(self.latencies_s) if self.latencies_s else None

    def to_json(self) -> dict[str, object]:
        """Returns the row as plain data."""
        return {
            "views": list(self.setting.views),
            "look_back": self.setting.look_back,
            "trials": self.trials,
            "successes_before": self.before,
            "successes_after": self.after,
            "interval_95_after": clopper_pearson(self.after, self.trials),
            "revisions": list(self.revisions),
            "revisions_mean": self.mean_revisions,
            "questions": self.questions,
            "input_tokens": self.input_tokens,
            "output_tokens": self.output_tokens,
            "latency_s_mean": self.mean_latency_s,
            "waited_s": sum(self.latencies_s),
            "stopped": self.stopped,
        }


def row_of(
    setting: AblationSetting, episodes: Sequence[tuple[Evolution, Conversation]], stopped: str = ""
) -> AblationRow:
    """Returns the result of a setting's episodes.

    Args:
        setting: Cameras and look-back.
        episodes: Each with what was said to the model; tokens and times are counted from there, so that a replay has
            those of the recorded run.
        stopped: Why the model was asked nothing more.
    """
    evolutions = [evolution for evolution, _ in episodes]
    rounds = [said for _, conversation in episodes for said in conversation.rounds]
    return AblationRow(
        setting=setting,
        trials=len(evolutions),
        before=sum(evolution.succeeded_at_once for evolution in evolutions),
        after=sum(evolution.succeeded for evolution in evolutions),
        revisions=tuple(evolution.revisions for evolution in evolutions if evolution.succeeded),
        questions=len(rounds),
        input_tokens=sum(said.input_tokens or 0 for said in rounds),
        output_tokens=sum(said.output_tokens or 0 for said in rounds),
        latencies_s=tuple(said.latency_s for said in rounds),
        stopped=stopped,
    )


def table(rows: Sequence[AblationRow]) -> str:
    """Returns the rows as a table of Markdown, for a terminal and for a page alike."""
    head = ("views", "p1", "success", "at once", "revisions", "questions", "tokens in + out", "s an answer")
    cells = [head, *(_cells(row) for row in rows)]
    widths = [max(len(line[column]) for line in cells) for column in range(len(head))]
    lines = [f"| {' | '.join(cell.ljust(width) for cell, width in zip(line, widths, strict=True))} |" for line in cells]
    rule = f"|{'|'.join('-' * (width + 2) for width in widths)}|"
    return "\n".join((lines[0], rule, *lines[1:]))


def _cells(row: AblationRow) -> tuple[str, ...]:
    revisions, latency = row.mean_revisions, row.mean_latency_s
    return (
        row.setting.letters or "-",
        str(row.setting.look_back),
        f"{row.after}/{row.trials}",
        f"{row.before}/{row.trials}",
        "-" if revisions is None else f"{revisions:.2f}",
        str(row.questions),
        f"{row.input_tokens} + {row.output_tokens}",
        "-" if latency is None else f"{latency:.1f}",
    )
