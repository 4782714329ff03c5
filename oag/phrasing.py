"""Other sentences for one request: its verb exchanged for another of the same meaning, in courteous frames.

Nothing is read here. A planner that reads sentences can keep those that it reads alike, as `llm` does.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

_VERBS = {
    "open": ("open", "open up", "pull open"),
    "close": ("close", "shut", "push shut"),
    "shut": ("close", "shut", "push shut"),
    "pick up": ("pick up", "grab", "take", "lift", "get"),
    "grab": ("pick up", "grab", "take", "lift", "get"),
    "get": ("pick up", "grab", "take", "lift", "get"),
    "lift": ("pick up", "grab", "take", "lift", "get"),
    "put": ("put", "place", "set", "move"),
    "place": ("put", "place", "set", "move"),
    "move": ("put", "place", "set", "move"),
}
# Polite phrases around a request, and the frames that replace them.
_AROUND = re.compile(r"^(?:(?:please|could you|can you|would you)\b[ ,]*)+|(?:[ ,]*\bplease\b|\?)+$", re.IGNORECASE)
_FRAMES = ("{}", "please {}", "could you {}?", "{}, please", "I want you to {}")


def rephrasings(query: str) -> Iterator[str]:
    """Yield other sentences for a request that begins with its verb; of any other, courteous forms.

    Example:
        >>> next(rephrasings("open the drawer"))
        'open up the drawer'
    """
    wish = _AROUND.sub("", query.strip())
    verb = next((verb for verb in _VERBS if wish.startswith(f"{verb} ")), "")
    for frame in _FRAMES:
        for other in _VERBS.get(verb, ("",)):
            text = frame.format(other + wish.removeprefix(verb))
            if text != query:
                yield text
