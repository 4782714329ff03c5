"""Texts by which a model says that there is nothing to say, such as "None" or "No anomalies observed."

They stand where an empty text was asked for. Read as remarks they would turn into faults and refusals. Only words of
which no other meaning can be made are read so: "No contact was made" and "Nothing was grasped" are remarks.
"""

from __future__ import annotations

import re

_NONE = frozenset({"", "null", "none", "nil", "n/a", "not applicable", "-", "–", "—"})
_DENYING = frozenset({"no", "none", "nothing", "without"})


def _words(listed: str) -> frozenset[str]:
    return frozenset(listed.split())


# What is good news when there is none of it ...
_BAD = _words(
    "anomaly anomalies abnormality abnormalities irregularity irregularities deviation deviations problem problems "
    "issue issues fault faults error errors collision collisions anomalous abnormal unusual unexpected unintended "
    "undesired unwanted wrong report"
)
# ... and what may stand around it without changing that.
_AROUND = _words(
    "there is are was were has have been be observed detected seen found noted noticed visible identified apparent "
    "evident obvious present reported occurred during in at of to for with the this that a any all or and other "
    "step action motion movement movements behavior behaviour event events contact contacts"
)
_WORD = re.compile(r"[a-z]+")
_LONGEST = 200


def says_nothing(text: str) -> bool:
    """Decides whether a text only says that there is nothing to say."""
    plain = text.strip().rstrip(".!").lower()
    if plain in _NONE:
        return True
    words = _WORD.findall(plain) if len(plain) <= _LONGEST else []
    first = next((word for word in words if word not in ("there", "is", "are", "was", "were")), "")
    if first not in _DENYING or not all(word in _BAD or word in _AROUND or word in _DENYING for word in words):
        return False
    return first == "none" or any(word in _BAD for word in words)


def begins_with_denial(text: str) -> bool:
    """Decides whether a text begins like one that says that there is nothing to say."""
    words = _WORD.findall(text[:_LONGEST].lower())
    return bool(words) and words[0] in (*_DENYING, "not")
