"""The checks by name, in the order in which they run; a check is a function of a context that returns a result."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from benchmarks.bddl_evaluation import check_evaluation
from benchmarks.conformance.coherence import check_coherence
from benchmarks.conformance.context import Check
from benchmarks.conformance.fuzz import check_fuzz
from benchmarks.conformance.libero import check_libero
from benchmarks.conformance.lint import check_lint
from benchmarks.conformance.mutation import check_mutants
from benchmarks.conformance.reading import check_reading, check_round_trip
from benchmarks.conformance.speed import check_speed
from benchmarks.conformance.tolerance import check_tolerance
from benchmarks.conformance.truth import check_truth

CHECKS: Mapping[str, Check] = MappingProxyType(
    {
        "reading": check_reading,
        "round-trip": check_round_trip,
        "tolerance": check_tolerance,
        "truth": check_truth,
        "mutants": check_mutants,
        "fuzz": check_fuzz,
        "coherence": check_coherence,
        "lint": check_lint,
        "libero": check_libero,
        "speed": check_speed,
        "evaluation": check_evaluation,
    }
)
