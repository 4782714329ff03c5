"""Policies that are learned from stored demonstrations: windows of data, networks, training, evaluation.

Everything in here needs the extra "learn"; importing it says so where that is missing.
"""

from executor.machine.extras import require

for _library in ("torch", "safetensors"):
    require(_library, "learn")
