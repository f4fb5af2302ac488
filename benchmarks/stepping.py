"""Environment steps a second, NumPy arrays of actions in and of observations out, beside JAX on the same cores.

``python -m benchmarks.stepping`` prints the table (a minute); ``--write FILE`` puts it between the file's two marks.
``--bound`` prints what a step of a compiled plant and controller costs in a loop of one's own, called and bound.
"""

import argparse
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from timeit import Timer
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.by_hand.arrays import ByHand
from benchmarks.by_hand.parameters import parameters_from
from benchmarks.by_hand.plant import constants
from benchmarks.case import Case
from benchmarks.document import markdown, put, times
from benchmarks.peers.peer import UnavailableError
from benchmarks.report import machine
from dualwinch.codegen.native import compile as compile_function
from dualwinch.simulation.blocks import block
from dualwinch.simulation.paper import case as paper_case
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.stepper.environments.environment import VectorEnvironment
from dualwinch.toolboxes.stepper.stepper import Stepper

Floats: TypeAlias = NDArray[np.float64]
Step: TypeAlias = Callable[[Floats], Floats]
"""``(torques) -> positions``, (n, 2) in N m and (n,) in m, both NumPy's, one sample on."""

ENVIRONMENTS = (1, 64, 1024)
"""How many are stepped side by side."""

ROUNDS, ROUND = 7, 0.3
"""Interleaved rounds, and about how long each peer steps in one, in s."""

CHECKED, TOLERANCE = 1000, 1e-6
"""Samples after which positions are compared, and how far apart in m they may be."""

JAX = "JAX, `vmap` and `jit`"


def _stepper(case: Case, count: int, *, exact: bool) -> tuple[Step, Callable[[], None]]:
    stepper = Stepper(case.experiment, count, exact=exact, record=False)

    def reset() -> None:
        stepper.reset()

    return lambda torques: stepper.step(torques)["x_sensed"], reset


def _environment(case: Case, count: int) -> tuple[Step, Callable[[], None]]:
    envs = VectorEnvironment(count, case.experiment, command="torques", hold=1)
    position = envs.observed.index("x_sensed")

    def step(torques: Floats) -> Floats:
        return envs.step({"tau_1": torques[:, 0], "tau_2": torques[:, 1]})[0][:, position]

    def reset() -> None:
        envs.reset(seed=0)

    return step, reset


def _jax(case: Case, count: int) -> tuple[Step, Callable[[], None]]:
    """The same plant by RK4 × 4, compiled as one function; the state stays with JAX, observations come as one array."""
    try:
        import jax  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise UnavailableError("jax is not installed") from error
    jax.config.update("jax_enable_x64", val=True)
    numbers = parameters_from(case.named_parameters)
    by_hand = ByHand(jax.numpy, numbers, constants(numbers))
    sample_time, substeps = case.experiment.simulation.sample_time, case.substeps
    h = sample_time / substeps

    def one(motion: Any, k: Any, torques: Any) -> tuple[Any, Any]:
        def part(index: Any, now: Any) -> Any:
            return by_hand.rk4(k * sample_time + index * h, now, torques[0], torques[1], h)

        following = jax.lax.fori_loop(0, substeps, part, motion)
        return following, jax.numpy.stack([*following, *by_hand.tensions(following)])

    step = jax.jit(jax.vmap(one, in_axes=(0, None, 0)))
    start = tuple(np.full(count, value) for value in case.start[:6])
    carried: dict[str, Any] = {}

    def reset() -> None:
        carried.update(motion=start, k=0.0)

    def run(torques: Floats) -> Floats:
        carried["motion"], observed = step(carried["motion"], carried["k"], torques)
        carried["k"] += 1.0
        return np.asarray(observed)[:, 0]

    return run, reset


PEERS: dict[str, Callable[[Case, int], tuple[Step, Callable[[], None]]]] = {
    "`Stepper`, exact": lambda case, count: _stepper(case, count, exact=True),
    "`Stepper`, in vector lanes": lambda case, count: _stepper(case, count, exact=False),
    "`VectorEnvironment`, rewards and episodes too": _environment,
    JAX: _jax,
}
"""Who is measured."""


class Actions:
    """Torques of every sample: those of the paper's controller, for each environment moved by up to 1 N m."""

    def __init__(self, case: Case, count: int) -> None:
        run = simulate(case.experiment)
        self._around = np.stack([run["tau_1"], run["tau_2"]], axis=1)
        self._moved = np.random.default_rng(0).uniform(-1, 1, (16, count, 2))

    def __getitem__(self, sample: int) -> Floats:
        """(count, 2) in N m."""
        return self._around[sample] + self._moved[sample % len(self._moved)]


def check(case: Case, count: int) -> float:
    """Largest distance in m between the positions of all peers after some samples of the same torques.

    Raises:
        ValueError: it is above `TOLERANCE`.
    """
    ends: list[Floats] = []
    actions = Actions(case, count)
    for prepare in PEERS.values():
        step, reset = prepare(case, count)
        reset()
        positions = np.zeros(count)
        for sample in range(CHECKED):
            positions = step(actions[sample])
        ends.append(positions)
    apart = float(np.ptp(np.array(ends), axis=0).max())
    if not apart <= TOLERANCE:
        raise ValueError(f"positions of {count} environments are {apart:.2e} m apart, allowed are {TOLERANCE:g} m")
    return apart


def measure(case: Case, count: int, rounds: int = ROUNDS, seconds: float = ROUND) -> dict[str, float]:
    """Peer → environment steps a second, the median of interleaved rounds."""
    actions = Actions(case, count)
    ready = {name: prepare(case, count) for name, prepare in PEERS.items()}
    rates: dict[str, list[float]] = {name: [] for name in PEERS}
    for _ in range(rounds):
        for name, (step, reset) in ready.items():
            reset()
            step(actions[0])
            sample, began = 1, time.perf_counter()
            while (passed := time.perf_counter() - began) < seconds and sample < case.samples:
                step(actions[sample])
                sample += 1
            rates[name].append((sample - 1) * count / passed)
    return {name: median(found) for name, found in rates.items()}


def step_costs(seconds: float = 0.003, rounds: int = 200) -> dict[str, tuple[float, float]]:
    """Block → least time in µs of a step of Case 4, called as a NumPy function and bound to arrays of its own."""
    costs: dict[str, tuple[float, float]] = {}
    for name in ("plant", "controller"):
        made = block(name, paper_case(4))
        state, inputs, parameters = (
            [variable.start for variable in part] for part in (made.states, made.inputs, made.parameters)
        )
        step = compile_function(made.step)
        bound = step.bind(parameters=parameters)
        bound.inputs["state"][:], bound.inputs["input"][:] = state, inputs
        timers = Timer(partial(step, state, inputs, parameters)), Timer(bound)
        counts = [max(int(seconds / timer.timeit(100) * 100), 1) for timer in timers]
        called, alone = (
            1e6 * min(timer.repeat(rounds, count)) / count for timer, count in zip(timers, counts, strict=True)
        )
        costs[name] = called, alone
    return costs


def table(rates: dict[int, dict[str, float]]) -> str:
    """Rates in thousands a second, and how many times JAX's they are."""
    headings = ["environments", *map(str, rates), *(f"over JAX: {count}" for count in rates)]
    rows = []
    for name in PEERS:
        found = [f"{rates[count][name] / 1e3:,.0f}".replace(",", " ") for count in rates]
        ratios = ["" if name == JAX else times(rates[count][name] / rates[count][JAX]) for count in rates]
        rows.append([name, *found, *ratios])
    return markdown(headings, rows)


def main() -> int:
    """Check, measure, and print or write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    parser.add_argument("--bound", action="store_true", help="cost of a step in a loop of one's own alone")
    arguments = parser.parse_args()
    if arguments.bound:
        rows = [[name, *(f"{cost:.2g}" for cost in costs)] for name, costs in step_costs().items()]
        print(markdown(["block", "called (µs)", "bound (µs)"], rows))
        return 0
    case, rates, apart = Case(), {}, 0.0
    try:
        for count in ENVIRONMENTS:
            sys.stderr.write(f"{count} environments\n")
            apart = max(apart, check(case, count))
            rates[count] = measure(case, count)
    except (UnavailableError, ValueError) as error:
        sys.stderr.write(f"error: {error}\n")
        return 1
    facts = " · ".join(f"{name}: {value}" for name, value in machine().items())
    text = f"{table(rates)}\n\n*Thousands a second; positions at most {apart:.1e} m apart. {facts}*"
    print(text)
    if arguments.write:
        put(arguments.write, "stepping", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
