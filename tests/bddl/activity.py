"""Activities in the style of BEHAVIOR, written for the tests."""

from __future__ import annotations

ACTIVITY = """\
(define (problem Rinse_Three_Cups-0)
    (:domain omnigibson)

    (:objects
        cup.n.01_1 cup.n.01_2 cup.n.01_3 - cup.n.01
        saucer.n.02_1 saucer.n.02_2 - saucer.n.02
        sink.n.01_1 sink.n.01_* - sink.n.01
        water.n.06_1 - water.n.06
        tea.n.05_1 - tea.n.05
        countertop.n.01_1 - countertop.n.01
        floor.n.01_1 - floor.n.01
        agent.n.01_1 - agent.n.01
    )

    (:init
        (ontop cup.n.01_1 countertop.n.01_1)
        (ontop cup.n.01_2 countertop.n.01_1)
        (inside cup.n.01_3 sink.n.01_1)
        (ontop saucer.n.02_1 countertop.n.01_1)
        (ontop saucer.n.02_2 countertop.n.01_1)
        (insource sink.n.01_1 water.n.06_1)
        (not
            (covered saucer.n.02_1 water.n.06_1)
        )
        (future tea.n.05_1)
        (inroom sink.n.01_1 kitchen)
        (inroom sink.n.01_* kitchen)
        (inroom countertop.n.01_1 kitchen)
        (inroom floor.n.01_1 kitchen)
        (ontop agent.n.01_1 floor.n.01_1)
    )

    (:goal
        (and
            (real ?tea.n.05_1)
            (forall
                (?cup.n.01 - cup.n.01)
                (not
                    (covered ?cup.n.01 ?water.n.06_1)
                )
            )
            (forn
                (2)
                (?cup.n.01 - cup.n.01)
                (ontop ?cup.n.01 countertop.n.01_1)
            )
            (forpairs
                (?cup.n.01 - cup.n.01)
                (?saucer.n.02 - saucer.n.02)
                (ontop ?cup.n.01 ?saucer.n.02)
            )
            (fornpairs
                (1)
                (?cup.n.01 - cup.n.01)
                (?saucer.n.02 - saucer.n.02)
                (nextto ?cup.n.01 ?saucer.n.02)
            )
            (imply
                (filled ?cup.n.01_1 ?tea.n.05_1)
                (or
                    (ontop ?cup.n.01_1 ?saucer.n.02_1)
                    (exists
                        (?saucer.n.02 - saucer.n.02)
                        (ontop ?cup.n.01_1 ?saucer.n.02)
                    )
                )
            )
        )
    )
)
"""


def edited(old: str, new: str, text: str = ACTIVITY) -> str:
    """Return a text with one place of it replaced.

    Raises:
        ValueError: The place is not there, or is there more than once.
    """
    if text.count(old) != 1:
        raise ValueError(f"{old!r} is there {text.count(old)} times.")
    return text.replace(old, new)


def line_of(old: str, text: str = ACTIVITY) -> int:
    """Return the line on which a piece of text begins."""
    return text[: text.index(old)].count("\n") + 1
