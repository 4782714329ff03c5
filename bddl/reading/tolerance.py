"""The mistakes that the reference implementation lets pass, and how it reads a text that has them.

Source: PyPI bddl 3.6.0, functions `scan_tokens`, `parse_problem` and `compile_state`.
"""

from __future__ import annotations

# Codes, or `code:case` where only one case of the code passes. Reading a tolerated mistake goes on as described here.
REFERENCE_TOLERATES = frozenset(
    {
        # Sections. The first of two counts, except that two goals are joined, the later one first, and that objects
        # are merged category by category, the first line of a category winning over those of a later section.
        "bad-section:stray",  # a word, or a form without a head, between sections: dropped
        "bad-section:name",  # several words where one name belongs: the last is the name
        "missing-section:problem",
        "missing-section::domain",  # the caller names the domain
        "missing-section::objects",
        "repeated-section",
        "unknown-section",  # dropped
        "several-formulas:goal",  # dropped, but for the first
        # Objects.
        "bad-objects:untyped",  # names without a category at the end: their category is `object`
        "bad-name:odd",  # any word can be a name
        "repeated-category",  # the later line replaces the earlier one
        "repeated-object",  # stays twice
        "wrong-category",
        # Formulas. Question marks are stripped from both ends of a name.
        "wrong-arity:surplus",  # what follows the first formula inside `not`: dropped
        "bad-binder:hyphen",  # another word in place of the hyphen, for two variables only
        "bad-count:loose",  # a number without parentheses: its first digit counts
        "bad-count:surplus",  # several numbers: the first counts
        # The initial state. Atoms with `inroom` are never looked at, so any room, object and number of names passes.
        "bad-init:formula",
        "bad-init:mark",
        "contradictory-init",
        "negative-kinematics",
        "unknown-object:inroom",
        "unknown-room",
        "wrong-arity:inroom",
        # Across sections.
        "bad-wildcard",
        "future-without-real",
        "misplaced-predicate",
    }
)
