"""Looks for random plans on whose canonical form the order of changes has a say.

    python -m benchmarks.change_orders --plans 20000 --seed 92 --rounds 2

Each plan gets one to three mistakes of wording a round. All orders of the rules' changes are followed; plans with more
than 250 forms in between, and those that are not well formed, are left out. Each plan with two forms is printed.

Source: docs/canonical.md, Rules.
"""

from __future__ import annotations

import argparse
from collections import Counter

import hypothesis
from rich.progress import Progress
from scipy.stats import beta

from oag.normal_form.canonical import prepared
from oag.task.wellformed import check
from tests.oag.orders import TooManyOrders, forms
from tests.properties.noisy import noisy_cases
from tests.properties.plans import Case

_MOST = 250


def outcome(case: Case) -> str:
    """Tells what became of one plan."""
    task, scene = case.task(), case.scene()
    if check(prepared(task, scene), scene):
        return "not well formed"
    try:
        return "one form" if len(forms(task, most=_MOST)) == 1 else "two forms"
    except TooManyOrders:
        return "too many orders"


def search(plans: int, seed: int, rounds: int) -> Counter[str]:
    """Counts what became of random plans; Ctrl-C ends the search and keeps the count."""
    counts: Counter[str] = Counter()
    with Progress() as progress:
        bar = progress.add_task("plans", total=plans)

        @hypothesis.seed(seed)
        @hypothesis.settings(
            max_examples=plans,
            deadline=None,
            database=None,
            phases=[hypothesis.Phase.generate],
            suppress_health_check=list(hypothesis.HealthCheck),
        )
        @hypothesis.given(noisy_cases(rounds=rounds))
        def look(case: Case) -> None:
            found = outcome(case)
            counts[found] += 1
            if found == "two forms":
                progress.console.print(case)
            progress.advance(bar)

        try:
            look()
        except KeyboardInterrupt:
            progress.console.print("Ended early.")
    return counts


def main() -> None:
    """Prints the counts, and how rare plans with two forms are at most."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plans", type=int, default=20_000, help="how many random plans")
    parser.add_argument("--seed", type=int, default=0, help="hypothesis seed")
    parser.add_argument("--rounds", type=int, default=2, help="rounds of one to three mistakes each")
    options = parser.parse_args()
    counts = search(options.plans, options.seed, options.rounds)
    for name, number in counts.most_common():
        print(f"{name}: {number}")
    found, looked_at = counts["two forms"], counts["one form"] + counts["two forms"]
    if looked_at > found:
        most = beta.ppf(0.95, found + 1, looked_at - found)
        print(f"with two forms, one-sided 95 % (Clopper-Pearson): at most {most:.1e} of such plans")


if __name__ == "__main__":
    main()
