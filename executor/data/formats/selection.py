"""Select the motions of a store that make one data set, and report what does not go together.

A selection is a text of keys and values, such as "origin=T5+T6,views=head" or "seed=3+5". Of several values, one has to
hold. `views` differs: it selects motions with pictures of all these views, and the data set has these alone.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from bddl import near_names
from bddl.errors import Scene2DemoError
from executor.data.store import NOT_AUDITED
from executor.data.views import DEPTH, SEGMENTATION
from oag.model.robots import FULL_SIZE, PAPER_ROBOT, Robot

NO_VIEWS = "none"
SUCCEEDED, FAILED = "succeeded", "failed"
_KEYS = {
    "episode": "its folder's name, as `view` lists them",
    "seed": "its seed",
    "origin": "family, or a sentence's label, as `dataset info` lists them",
    "ended": "how episodes ended",
    "audited": "the verdict of `dataset audit`",
    "rate": "samples a second",
    "robot": "its name, or 0.7 and 1 for the Pandas without a lift",
    "views": "cameras with pictures",
    "size": "width x height of pictures",
    "channels": "kinds of pictures beside colours",
}
_EACH = ("episode", "seed")  # Of many values, so that they are not listed.
_LEGAL = {
    "ended": (SUCCEEDED, FAILED),
    "audited": ("sound", "flawed", "undecided", NOT_AUDITED),
    "channels": (DEPTH, SEGMENTATION),
}
"""Legal values of keys, whatever the store."""


def _robot_value(robot: Robot) -> str:
    """Return the value that selects a robot: its scale, as before robots had names, else its name."""
    return f"{robot.scale:g}" if robot in (PAPER_ROBOT, FULL_SIZE) else robot.name


class NothingToExport(Scene2DemoError, ValueError):
    """A store has no demonstrations that make one data set."""


class BadSelection(NothingToExport):
    """A selection is invalid for a store."""


@dataclass(frozen=True, slots=True)
class Traits:
    """Properties of a motion that selections refer to.

    Attributes:
        episode: Name of its unit's folder.
        seed: Its seed.
        origin: Label of the origin of scene and task.
        ended: Ending of its unit.
        rate_hz: Samples per second.
        robot: The robot's record.
        views: View -> width and height of its pictures.
        channels: View -> kinds of pictures besides colours.
        audited: Verdict of its audit; "no" without one.
    """

    episode: str
    seed: int
    origin: str
    ended: str
    rate_hz: float
    robot: Robot
    views: Mapping[str, tuple[int, int]]
    channels: Mapping[str, Collection[str]]
    audited: str = NOT_AUDITED

    def values(self, key: str, views: Sequence[str] | None) -> set[str]:
        """Return the values of a key that match this motion; for pictures, those of some views or of all."""
        chosen = self.views if views is None else [view for view in views if view in self.views]
        if key == "views":
            return {*self.views, NO_VIEWS}
        if key == "size":
            return {size_text(self.views[view]) for view in chosen}
        if key == "channels":
            return {kind for kind in _LEGAL["channels"] if chosen and all(kind in self.channels[v] for v in chosen)}
        single = {
            "episode": self.episode,
            "seed": str(self.seed),
            "origin": self.origin,
            "ended": self.ended,
            "audited": self.audited,
            "rate": f"{self.rate_hz:g}",
            "robot": _robot_value(self.robot),
        }
        return {single[key]}


@dataclass(frozen=True, slots=True)
class Selection:
    """Selection of motions.

    Attributes:
        chosen: Key -> its values; an absent key matches anything.
    """

    chosen: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @classmethod
    def parse(cls, text: str) -> Selection:
        """Parse a selection.

        Raises:
            BadSelection: It is invalid.
        """
        chosen: dict[str, tuple[str, ...]] = {}
        for part in text.split(",") if text.strip() else ():
            key, equals, values = (word.strip() for word in part.partition("="))
            named = tuple(value.strip() for value in values.split("+"))
            if not equals or not all(named) or len(set(named)) < len(named):
                raise BadSelection(
                    f"{part.strip()!r} chooses nothing: expected KEY=VALUE, or KEY=VALUE+VALUE, {_known()}"
                )
            if key not in _KEYS:
                raise BadSelection(f"episodes have no {key!r}: expected {_known()}")
            if key in chosen:
                raise BadSelection(f"{key} is there twice: expected all of its values at once, such as {key}=A+B")
            chosen[key] = tuple(_number(value) for value in named) if key in ("rate", "robot") else named
        if NO_VIEWS in chosen.get("views", ()):
            if len(chosen["views"]) > 1:
                raise BadSelection(f"views={NO_VIEWS} stands alone: expected it, or names of views")
            if both := sorted({"size", "channels"} & set(chosen)):
                raise BadSelection(f"views={NO_VIEWS} leaves no pictures that have {' and '.join(both)}")
        return cls(chosen)

    @property
    def text(self) -> str:
        """The selection as text."""
        return ",".join(f"{key}={'+'.join(values)}" for key, values in self.chosen.items())

    @property
    def views(self) -> tuple[str, ...] | None:
        """Views of the data set; None where they are not selected."""
        named = self.chosen.get("views")
        return () if named == (NO_VIEWS,) else named

    def check(self, found: Collection[Traits], store: object) -> None:
        """Refuse values that no motion has, and no motion could have.

        Raises:
            BadSelection: There is one.
        """
        for key, values in self.chosen.items():
            legal = {value for one in found for value in one.values(key, None)} | {*_LEGAL.get(key, ())}
            if unknown := [value for value in values if value not in legal]:
                named = near_names(unknown[0], tuple(legal)) if key in _EACH else sorted(legal - {NO_VIEWS})
                words = ", ".join(named) or ("other ones" if key in _EACH else "nothing")
                also = f", or {NO_VIEWS}" if key == "views" else ""
                raise BadSelection(f"{store} has no {key} {' or '.join(unknown)}: it has {words}{also}")

    def takes(self, one: Traits) -> bool:
        """Decide whether a motion is selected."""
        for key, values in self.chosen.items():
            has = one.values(key, self.views)
            if not (set(values) <= has if key in ("views", "channels") else has and has <= set(values)):
                return False
        return True

    def nothing(self, found: Sequence[Traits], not_kept: int, store: object) -> NothingToExport:
        """Return the refusal of a store without a selected motion.

        Args:
            found: Traits of all its motions.
            not_kept: Number of its episodes without motion.
            store: Its name.
        """
        aside = f"; of {not_kept} more no motion was kept (`generate --failures` keeps that of failed ones)"
        words = aside if not_kept else ""
        if not self.chosen:
            return NothingToExport(f"{store} has no success with samples, and only these are exported{words}")
        listed = "; ".join(
            f"{key} {', '.join(f'{value} ({count})' for value, count in sorted(counts.items()))}"
            for key in _KEYS
            if key not in _EACH
            and (counts := Counter(value for one in found for value in one.values(key, None) - {NO_VIEWS}))
        )
        return BadSelection(
            f"no episode of {store} is chosen by --only {self.text}: its motions have {listed or 'nothing'}{words}"
        )

    def common(self, found: Sequence[Traits], kinds: Collection[str], store: object) -> dict[str, tuple[int, int]]:
        """Return the views, with picture sizes, that all selected motions have.

        Args:
            found: Traits of the selected motions, at least one.
            kinds: Requested pictures besides colours.
            store: Its name.

        Raises:
            NothingToExport: They do not make one data set; the message says what to select.
        """
        if len({one.rate_hz for one in found}) > 1:
            rates = ", ".join(f"{rate:g}" for rate in sorted({one.rate_hz for one in found}))
            words = f"{store} has episodes of {rates} samples a second, and a data set has one rate"
            raise self._mixed(found, "rate", words)
        if len({one.robot.name for one in found}) > 1:
            raise self._mixed(found, "robot", f"{store} has episodes of different robots, and a data set has one")
        if self.views is None and len({frozenset(one.views) for one in found}) > 1:
            raise self._other_views(found, store)
        views = sorted(found[0].views if self.views is None else self.views)
        if len({tuple(one.views[view] for view in views) for one in found}) > 1:
            raise self._mixed(found, "size", f"{store} has pictures of different sizes, and a data set has one")
        for kind in sorted(kinds):
            without = sum(kind not in one.values("channels", views) for one in found)
            if without:
                words = f"{without} of {len(found)} episodes of {store} have no {kind}"
                choices = [f"without --include {kind}"]
                if without < len(found):
                    choices.append(self._choice("channels", kind, len(found) - without))
                raise NothingToExport(f"{words}; export {', or '.join(choices)}")
        return {view: found[0].views[view] for view in views}

    def _mixed(self, found: Sequence[Traits], key: str, words: str) -> NothingToExport:
        counts = Counter(value for one in found for value in one.values(key, self.views))
        choices = [self._choice(key, value, counts[value]) for value in sorted(counts, key=_by_number)]
        return NothingToExport(f"{words}; export {', or '.join(choices)}")

    def _other_views(self, found: Sequence[Traits], store: object) -> NothingToExport:
        sets = Counter(frozenset(one.views) for one in found)
        mixed = ", ".join(f"{count} have {_and(views)}" for views, count in sorted(sets.items(), key=_by_count))
        useful = {*sets, frozenset.intersection(*sets)} - {frozenset()}
        counts = {views: sum(views <= set(one.views) for one in found) for views in useful}
        choices = [
            self._choice("views", "+".join(sorted(views)), count)
            for views, count in sorted(counts.items(), key=_by_count)
        ]
        choices.append(f"{self._choice('views', NO_VIEWS, len(found))} without pictures")
        return NothingToExport(
            f"{store} has episodes with pictures of different views ({mixed}), and a data set has the same in all; "
            f"export {', or '.join(choices)}; `dataset render` draws the same pictures of all"
        )

    def _choice(self, key: str, value: str, count: int) -> str:
        """Describe a further restriction of the selection, and its number of episodes."""
        more = Selection({**self.chosen, key: (value,)})
        return f"{count} with --only {more.text}"


EVERYTHING = Selection()
WITHOUT_PICTURES = Selection({"views": (NO_VIEWS,)})


def size_text(size: tuple[int, int]) -> str:
    """Return a picture size as in selections."""
    return f"{size[0]}x{size[1]}"


def _number(value: str) -> str:
    """Normalise a number; other text stays."""
    try:
        return f"{float(value):g}"
    except ValueError:
        return value


def _known() -> str:
    return f"with a key out of {', '.join(f'{key} ({words})' for key, words in _KEYS.items())}"


def _and(views: frozenset[str]) -> str:
    return " and ".join(sorted(views)) or "none"


def _by_number(value: str) -> tuple[float, str]:
    head = value.partition("x")[0]
    return (float(head) if head.replace(".", "").isdecimal() else 0.0, value)


def _by_count(item: tuple[frozenset[str], int]) -> tuple[int, list[str]]:
    views, count = item
    return -count, sorted(views)
