"""Mistakes in an activity: the edit that makes each, the code it is reported with, and what the reference does."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Slip:
    """A mistake.

    Attributes:
        name: What is wrong.
        old: The text that is replaced, which is there once.
        new: What replaces it.
        code: The code of the first diagnostic.
        at: The text on which the diagnostic stands, as it is after the edit.
        tolerated: Whether the reference lets it pass.
    """

    name: str
    old: str
    new: str
    code: str
    at: str
    tolerated: bool = False


SLIPS = (
    # Sections.
    Slip("misspelt goal", "(:goal", "(:gaol", "unknown-section", ":gaol"),
    Slip("misspelt init", "(:init", "(:int", "unknown-section", ":int"),
    Slip("misspelt objects", "(:objects", "(:objets", "unknown-section", ":objets"),
    Slip("misspelt domain", "(:domain", "(:domian", "unknown-section", ":domian", True),
    Slip("no domain", "(:domain omnigibson)", "", "missing-section", "(define", True),
    Slip("unheard-of section", "(:init", "(:wishes) (:init", "unknown-section", ":wishes", True),
    Slip("unheard-of domain", "omnigibson", "omnigibsons", "unknown-domain", "omnigibsons"),
    Slip("two domains", "omnigibson)", "omnigibson omnigibson)", "bad-section", "(:domain omnigibson", True),
    Slip("junk", "    (:init", "    \\ (:init", "bad-section", "\\ (:init", True),
    Slip("empty section", "    (:init", "    () (:init", "bad-section", "() (:init"),
    Slip("second init", "    (:goal", "(:init (open sink.n.01_1)) (:goal", "repeated-section", ":init (open", True),
    Slip("goal of two", "    )\n)\n", "(open sink.n.01_1)\n    )\n)\n", "several-formulas", "(open sink", True),
    # Objects.
    Slip("no category", " - agent.n.01", "", "bad-objects", "agent.n.01_1\n    )", True),
    Slip("no name", "agent.n.01_1 - agent.n.01\n", "- agent.n.01\n", "bad-objects", "- agent.n.01\n"),
    Slip("odd name", "tea.n.05_1 -", "tea.n.05_1 t+a -", "bad-name", "t+a", True),
    Slip("odd category", "- floor.n.01", "- floor", "bad-name", "floor\n", True),
    Slip("other category", "- tea.n.05", "- water.n.05", "wrong-category", "tea.n.05_1 -", True),
    Slip(
        "category twice",
        "cup.n.01_2 cup.n.01_3 -",
        "- cup.n.01 cup.n.01_1 cup.n.01_2 cup.n.01_3 -",
        "repeated-category",
        "cup.n.01\n        saucer",
        True,
    ),
    Slip(
        "wildcard first",
        "sink.n.01_1 sink.n.01_* -",
        "sink.n.01_* sink.n.01_1 -",
        "bad-wildcard",
        "sink.n.01_* sink",
        True,
    ),
    # Start.
    Slip("unknown room", "sink.n.01_1 kitchen", "sink.n.01_1 kitchens", "unknown-room", "kitchens", True),
    Slip(
        "unknown object in a room", "(inroom sink.n.01_1", "(inroom sink.n.01_7", "unknown-object", "sink.n.01_7", True
    ),
    Slip("room of nothing", "(inroom sink.n.01_1 kitchen)", "(inroom kitchen)", "wrong-arity", "inroom kitchen)", True),
    Slip("unknown object", "(future tea.n.05_1", "(future tea.n.05_2", "unknown-object", "tea.n.05_2"),
    Slip("question mark", "(insource sink", "(insource ?sink", "bad-init", "?sink", True),
    Slip("disjunction", "(future tea.n.05_1)", "(or (future tea.n.05_1))", "bad-init", "(or (future", True),
    Slip(
        "contradiction",
        "(future tea.n.05_1)",
        "(future tea.n.05_1) (not (insource sink.n.01_1 water.n.06_1))",
        "contradictory-init",
        "(not (insource",
        True,
    ),
    Slip(
        "denied place",
        "(inside cup.n.01_3 sink.n.01_1)",
        "(not (inside cup.n.01_3 sink.n.01_1))",
        "negative-kinematics",
        "(not (inside",
        True,
    ),
    Slip(
        "place of what is to come",
        "(future tea.n.05_1)",
        "(future tea.n.05_1) (inside tea.n.05_1 cup.n.01_1)",
        "described-future",
        "(inside tea",
        True,
    ),
    Slip("no such thing to come", "(real ?tea.n.05_1)", "", "future-without-real", "(future tea", True),
    # Formulas.
    Slip(
        "goal in the start",
        "(future tea.n.05_1)",
        "(future tea.n.05_1) (real water.n.06_1)",
        "misplaced-predicate",
        "real water",
        True,
    ),
    Slip(
        "start in the goal",
        "(real ?tea.n.05_1)",
        "(real ?tea.n.05_1) (future ?tea.n.05_1)",
        "misplaced-predicate",
        "future ?tea",
        True,
    ),
    Slip(
        "wildcard in the goal",
        "(real ?tea.n.05_1)",
        "(real ?tea.n.05_1) (open ?sink.n.01_*)",
        "bad-wildcard",
        "?sink.n.01_*",
        True,
    ),
    Slip("unknown predicate", "(filled", "(fill", "unknown-predicate", "fill ?cup"),
    Slip("one name too few", "(filled ?cup.n.01_1", "(filled", "wrong-arity", "filled ?tea"),
    Slip("unbound variable", "(filled ?cup.n.01_1", "(filled ?cup.n.01", "unbound-variable", "?cup.n.01 ?tea"),
    Slip("undeclared object", "(filled ?cup.n.01_1", "(filled ?cup.n.01_9", "unknown-object", "?cup.n.01_9"),
    Slip("marks on both ends", "(real ?tea.n.05_1)", "(real ??tea.n.05_1?)", "bad-name", "??tea", True),
    Slip(
        "two negated",
        "(covered ?cup.n.01 ?water.n.06_1)",
        "(covered ?cup.n.01 ?water.n.06_1) (open ?cup.n.01)",
        "wrong-arity",
        "(open ?cup.n.01)",
        True,
    ),
    Slip(
        "unknown category",
        "(?saucer.n.02 - saucer.n.02)\n                        (",
        "(?saucer.n.02 - plate.n.02)\n                        (",
        "unknown-category",
        "plate.n.02",
    ),
    Slip("loose number", "(2)", "2", "bad-count", "2\n                (?cup", True),
    Slip("two numbers", "(2)", "(2 3)", "bad-count", "(2 3)", True),
    Slip("number in words", "(2)", "(two)", "bad-count", "(two)"),
    Slip(
        "no number",
        "(1)\n",
        "\n",
        "bad-count",
        "(?cup.n.01 - cup.n.01)\n                (?saucer.n.02 - saucer.n.02)\n                (nextto",
    ),
    Slip(
        "no hyphen for two",
        "(?saucer.n.02 - saucer.n.02)\n                (nextto",
        "(?saucer.n.02 in saucer.n.02)\n                (nextto",
        "bad-binder",
        "(?saucer.n.02 in",
        True,
    ),
    Slip(
        "no hyphen",
        "(?saucer.n.02 - saucer.n.02)\n                        (",
        "(?saucer.n.02 saucer.n.02)\n                        (",
        "bad-binder",
        "(?saucer.n.02 saucer",
    ),
    # Parentheses, which the indentation tells.
    Slip(
        "unclosed atom",
        "(future tea.n.05_1)",
        "(future tea.n.05_1",
        "missing-parenthesis",
        "\n        (inroom sink.n.01_1",
    ),
    Slip("unopened atom", "(future tea", "future tea", "missing-parenthesis", "future tea"),
    Slip("unclosed section", "    )\n\n    (:goal", "    \n\n    (:goal", "missing-parenthesis", "\n\n    (:goal"),
    Slip("opened twice", "(future", "((future", "extra-parenthesis", "((future"),
    Slip(
        "closed twice",
        "(future tea.n.05_1)",
        "(future tea.n.05_1))",
        "extra-parenthesis",
        ")\n        (inroom sink.n.01_1",
    ),
    Slip("closed early", "(future tea", "(future) tea", "extra-parenthesis", ") tea"),
)
