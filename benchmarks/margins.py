"""What stability margins as constraints add to a candidate of tuning.

``uv run --group benchmarks python -m benchmarks.margins`` evaluates the same candidates without such constraints and
with one and two of them, in turns, and prints the processor's time that a candidate takes.
"""

import time

import numpy as np

from dualwinch.tuning.constraints import ROBUST, default_constraints
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.ranking import Candidate
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.study import BATCH
from dualwinch.tuning.tuning_problem import tuning_problem

ROUNDS, SEED = 8, 1
SPREAD = 0.08
"""Standard deviation of the candidates about the start, in shares of each range."""


def main() -> None:
    """Evaluate and print."""
    evaluators = []
    for count in range(len(ROBUST) + 1):
        usual = [text for text in default_constraints(ensemble=True) if text not in ROBUST]
        constraints = ("none", *usual, *ROBUST[:count])
        problem = tuning_problem(ensemble="sea", constraints=constraints, seed=SEED)
        evaluators.append(Evaluator(prepare(problem)))
    problem = evaluators[0].training.problem
    space, start = problem.space, problem.space.encoded(problem.start)
    random, spent = np.random.default_rng(SEED), np.zeros(len(evaluators))
    for number in range(ROUNDS + 1):
        shares = np.clip(start + SPREAD * random.normal(size=(BATCH, len(start))), 0, 1)
        candidates = [Candidate(space.decoded(row), "benchmark") for row in shares]
        for index, evaluator in enumerate(evaluators):
            began = time.process_time()
            evaluator.evaluate(candidates)
            spent[index] += (time.process_time() - began) if number else 0.0  # the first round warms up
    for count, seconds in enumerate(spent):
        each = 1e3 * seconds / (ROUNDS * BATCH)
        print(f"{count} margins bounded: {each:.1f} ms of the processor a candidate")


if __name__ == "__main__":
    main()
