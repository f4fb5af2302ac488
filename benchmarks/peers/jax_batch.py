"""JAX on the processor: `benchmarks.by_hand.arrays` in one compiled `lax.scan` over samples, `vmap` over candidates.

By RK4 written by hand, or by diffrax called once a sample, because the controller is sampled. The torque held between
two samples changes at each, so a diffrax solve cannot bridge more than one.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.by_hand.arrays import ByHand
from benchmarks.by_hand.control import IDLE
from benchmarks.by_hand.parameters import parameters_from
from benchmarks.by_hand.plant import constants
from benchmarks.case import Case
from benchmarks.peers.candidates import gains
from benchmarks.peers.peer import Answer, Run, UnavailableError
from dualwinch.simulation.metrics.metrics import Metrics

Advance = Callable[[ByHand, Any, Any, Any, Any], Any]
"""``(by_hand, t, motion, tau_1, tau_2) -> motion`` at the sample's end."""


def _rk4(case: Case) -> Advance:
    from jax.lax import fori_loop  # pyright: ignore[reportMissingImports]

    h = case.experiment.simulation.sample_time / case.substeps

    def advance(by_hand: ByHand, t: Any, motion: Any, tau_1: Any, tau_2: Any) -> Any:
        def step(index: Any, now: Any) -> Any:
            return by_hand.rk4(t + index * h, now, tau_1, tau_2, h)

        return fori_loop(0, case.substeps, step, motion)

    return advance


def _diffrax(case: Case) -> Advance:
    try:
        import diffrax  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise UnavailableError("diffrax is not installed") from error
    duration = case.experiment.simulation.sample_time

    def advance(by_hand: ByHand, t: Any, motion: Any, tau_1: Any, tau_2: Any) -> Any:
        def slope(since: Any, state: Any, held: Any) -> Any:
            return by_hand.derivative(t + since, state, *held)

        solved: Any = diffrax.diffeqsolve(
            diffrax.ODETerm(slope),
            diffrax.Tsit5(),
            0.0,
            duration,
            duration / case.substeps,
            motion,
            (tau_1, tau_2),
            max_steps=case.substeps + 1,
            adjoint=diffrax.DirectAdjoint(),
        )
        return tuple(leaf[-1] for leaf in solved.ys)

    return advance


METHODS = {"rk4": _rk4, "diffrax": _diffrax}


def prepare_with(method: str) -> Callable[[Case], Run]:
    """Rollouts by a method of `METHODS`."""

    def prepare(case: Case) -> Run:
        try:
            import jax  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise UnavailableError("jax is not installed") from error
        jax.config.update("jax_enable_x64", val=True)
        cpu = jax.devices("cpu")[0]
        numbers = parameters_from(case.named_parameters)
        c, advance = constants(numbers), METHODS[method](case)
        sample_time = case.experiment.simulation.sample_time

        def one(l0: Any, start: Any, reference: Any, keep: Any) -> Any:
            by_hand = ByHand(jax.numpy, numbers._replace(l0=l0), c)

            def sample(carried: Any, given: Any) -> Any:
                motion, memory, so_far = carried
                k, now = given
                tau_1, tau_2, memory = by_hand.control(jax.numpy.where(k > 0, 0.0, 1.0), motion, now, memory)
                so_far = so_far + (motion[0] - now[0]) ** 2
                motion = advance(by_hand, k * sample_time, motion, tau_1, tau_2)
                return (motion, memory, so_far), (motion[0] if keep else None)

            memory = jax.tree.map(lambda value: value + 0 * l0, tuple(IDLE))
            carried = (tuple(start), memory, 0 * l0)
            (motion, _, so_far), positions = jax.lax.scan(sample, carried, (np.arange(len(reference)), reference))
            return motion[0], so_far / len(reference), positions

        batch = jax.jit(jax.vmap(one, in_axes=(0, None, None, None)), static_argnums=3)
        given = [jax.device_put(array, cpu) for array in (gains(case), case.start[:6], case.reference)]

        def run(*, keep: bool = False) -> Answer:
            first = [given[0][:1], *given[1:]]
            errors = np.asarray(jax.block_until_ready(batch(*given, False))[1])  # noqa: FBT003
            metrics = Metrics(**dict.fromkeys(Metrics.__dataclass_fields__, np.nan) | {"mse": float(errors[0])})
            if not keep:
                return Answer(np.nan, metrics, errors=errors)
            positions = np.asarray(batch(*first, True)[2])[0]  # noqa: FBT003
            return Answer(float(positions[-1]), metrics, positions, errors)

        run()
        return run

    return prepare
