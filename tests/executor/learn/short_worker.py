"""The worker of evaluations, with episodes of half a second."""

from __future__ import annotations

from executor.learn import evaluation, evaluation_worker

evaluation.MOST_S = 0.5

if __name__ == "__main__":
    evaluation_worker.main()
