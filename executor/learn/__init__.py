"""Policies learned from stored demonstrations: observations, networks, training, acting.

Everything here needs the extra "learn"; importing it raises `MissingExtra` where that is not installed.
"""

from executor.system.extras import require

for _library in ("torch", "safetensors"):
    require(_library, "learn")
