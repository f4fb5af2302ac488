"""Gains of the sliding-mode controller for a machine: formulas of its lag, its ropes and its drums.

The design has two parameters, `RESONANCE_MARGIN` and `LAG_RATIO`; everything else follows from the machine.

1. **Damping of the drums** d in N s/m at the rim: the wave impedance sqrt(E A mu) of the rope
   (`controllers.coordinations.winch_pid`), and at most m/(LAG_RATIO lag), so that the crossover of the damping stays
   well below the lag of drive, samples and load cell. m is the moving mass of drum and rope (`model.drum_on_rope`).
   On a shorter rope the drum's resonance w_d is faster. Where w_d lag exceeds a quarter of a turn, damping that late
   drives the drum: if margins ask for it, the damping fades on ropes shorter than that.
2. **Bandwidth** w, the smallest of: 1/(LAG_RATIO lag); the rule of the drums' resonance (`analysis.resonance`) with the
   margin RESONANCE_MARGIN, ``kv + L + ki G/R <= d/(RESONANCE_MARGIN m)``; and the first frequency of the spans over the
   same margin.
3. **Law.** Inside the boundary layer and below its smoothing the law is linear, per mass ``kp = eta + k/phi`` and
   ``kv = y q/p + kp/y`` with ``y = beta smoothing^(1 − p/q)``. Critical damping, ``kp = w²`` and ``kv = 2 w``, is a
   quadratic equation in y; of its roots the larger makes the slope grow less with the speed error. The smoothing is
   such that up to the largest speed error the slope does not exceed that at rest: what is stable at rest is stable
   after a push. The boundary layer ends where the ropes' force does.
4. **Filter**: bandwidth 2 w; all of the disturbance is compensated, or the share of integral action: to a vehicle that
   sticks to its rail, compensation is an integral of the force. What encoders tell of the vehicle's position is as
   uncertain as half the stretch of a rope. The law's own observer removes what the filter does not see, friction of
   drums and rollers: with w/50 at small errors, and as fast as the loop, with w more, at large ones.
5. **Tension loops**: ki = w/16 and kp = 1/100 times the lever from tension to torque.

Reference for 3: Khalil, Nonlinear Systems, 2002, Sections 7.2 and 14.1.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.laws.nftsm import Nftsm, NftsmGains
from dualwinch.controllers.nominal import nominal_plant
from dualwinch.model.drum_on_rope import drum_frequency, moving_mass, span_frequency, tangent_rigidity, wave_impedance
from dualwinch.model.plant import Plant, Side
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.scalar import present
from dualwinch.model.vehicle import inertia

RESONANCE_MARGIN = 2.0
"""Factor by which the loop gain at the drums' resonance may rise before it is 1."""

LAG_RATIO = 4.0
"""Least ratio of a loop's time constant to the lag in it: at the crossover the lag costs a phase of 14 degrees."""

OBSERVER, TENSION_INTEGRAL, TENSION_PROPORTIONAL = 1 / 50, 1 / 16, 1 / 100
"""Gains over the bandwidth, of the law's observer at small errors and of the integral of the tension; and the
proportional gain on the tension."""

FEEDBACK = 2.0 + OBSERVER + TENSION_INTEGRAL
"""What returns from a drum's speed in 1/s over the bandwidth: kv + L + ki G/R."""

LEAD = 0.4
"""Lead of the drums' damping as a share of the drives' lag.

It doubles the delay margin at a motor's torque, at the resonance of rotor and gearbox. A longer one amplifies
frequencies above that resonance: the delay margin on short ropes shrinks.
"""

LINEAR_SPEED = 0.01
"""Speed error in m/s above which the law stays linear with any smoothing, so that a search may lower that."""


@dataclass(frozen=True)
class LoopTiming:
    """Lags of a loop besides the plant."""

    drive: Annotated[float, Quantity("s", "lag of the drives")]
    load_cell: Annotated[float, Quantity("s", "lag of the load cells")]
    sample_time: Annotated[float, Quantity("s", "sampling period of the controller")]
    delay_samples: Annotated[int, Quantity("1", "delay of torque commands, in samples")]

    @property
    def sampling(self) -> float:
        """Lag by samples in s: one for the computer and half of one for the hold, and the delay of commands."""
        return (1.5 + self.delay_samples) * self.sample_time

    @property
    def lag(self) -> float:
        """Sum of the lags in s."""
        return self.drive + self.load_cell + self.sampling


@dataclass(frozen=True)
class Shares:
    """What margins leave of the formulas' values: shares of the bandwidth, the drums' damping and integral action.

    `fading` says whether the damping fades on ropes that are short for its lag (`damped_length`).
    """

    bandwidth: Annotated[float, Quantity("1", "share of the bandwidth")] = 1.0
    damping: Annotated[float, Quantity("1", "share of the damping of the drums")] = 1.0
    integral: Annotated[float, Quantity("1", "share of the gains of observers and tension integrals")] = 1.0
    fading: bool = False

    def towards(self, shares: "Shares") -> "Shares":
        """Half of the way to other shares, by geometric means."""
        return replace(
            self,
            bandwidth=math.sqrt(self.bandwidth * shares.bandwidth),
            damping=math.sqrt(self.damping * shares.damping),
            integral=math.sqrt(self.integral * shares.integral),
        )

    @property
    def named(self) -> dict[str, float]:
        """What it is a share of → the share."""
        return {
            "bandwidth": self.bandwidth,
            "damping of the drums": self.damping,
            "integral action": self.integral,
        }


ALL = Shares()
"""All of the formulas' values."""


@dataclass(frozen=True)
class BandwidthLimit:
    """The bandwidth of the position loop that one property of the machine allows."""

    cause: Annotated[str, Quantity("", "property of the machine")]
    bandwidth: Annotated[float, Quantity("rad/s", "largest bandwidth that it allows")]

    def __str__(self) -> str:
        """In words."""
        return f"{self.bandwidth:.3g} rad/s by the {self.cause}"


def drum_damping(side: Side, controller: Controller, plant: Plant, timing: LoopTiming) -> float:
    """Damping of a drum in N s/m at its rim (step 1)."""
    length = plant.track.length / 2
    impedance = wave_impedance(side.rope, controller.limits.preload / 2, length)
    return min(float(impedance), float(moving_mass(side, length, plant.track)) / (LAG_RATIO * timing.lag))


def damped_length(side: Side, controller: Controller, plant: Plant, timing: LoopTiming) -> float:
    """Length in m of a rope at whose resonance with its drum the lag is a quarter of a turn (step 1).

    The frequency is that of the rope in mid-track, which falls with the root of the length.
    """
    length = plant.track.length / 2
    frequency = float(drum_frequency(side, controller.limits.preload / 2, length, plant.track))
    return length * (frequency * timing.lag / (math.pi / 2)) ** 2


def bandwidth_limits(
    controller: Controller, plant: Plant, timing: LoopTiming, shares: Shares = ALL
) -> tuple[BandwidthLimit, ...]:
    """The bandwidths that lag, drums and spans allow (step 2), ascending; of both drums and ropes the smaller."""
    length, tension, track = plant.track.length / 2, controller.limits.preload / 2, plant.track
    drums, spans = list[BandwidthLimit](), list[BandwidthLimit]()
    for side in plant.sides:
        added = shares.damping * drum_damping(side, controller, plant, timing)
        rate = float((added + side.rope.tangent(tension, length)[1]) / moving_mass(side, length, track))
        cause = f"resonance of drum {side.number} on its rope"
        drums.append(BandwidthLimit(cause, rate / (RESONANCE_MARGIN * FEEDBACK)))
        if present(side.rope.submerged_weight):
            sag = float(span_frequency(side.rope, tension, length, track))
            spans.append(BandwidthLimit(f"sag of rope {side.number} in its spans", sag / RESONANCE_MARGIN))
    lag = BandwidthLimit("lag of drive, samples and load cell", 1 / (LAG_RATIO * timing.lag))
    # to nine digits, so that of two equal drums the first is named, whatever a processor rounds
    smallest = [min(limits, key=lambda limit: float(f"{limit.bandwidth:.9g}")) for limits in (drums, spans) if limits]
    return tuple(sorted((lag, *smallest), key=lambda limit: limit.bandwidth))


def bandwidth_of(limits: tuple[BandwidthLimit, ...], shares: Shares = ALL) -> float:
    """Bandwidth in rad/s of a design: the share of the smallest limit."""
    return shares.bandwidth * limits[0].bandwidth


def designed_controller(
    controller: Controller,
    plant: Plant,
    timing: LoopTiming,
    *,
    largest_speed_error: float,
    position_noise: float = 0.0,
    speed_noise: float = 0.0,
    shares: Shares = ALL,
) -> Controller:
    """A controller with the gains of the design; parts, limits and gains without a formula stay.

    Args:
        controller: with the sliding-mode law; gains that its parts do not have are left out.
        plant: that of the data sheets.
        timing: lags of the loop.
        largest_speed_error: in m/s, up to which the law's slope does not exceed that at rest.
        position_noise: of the position sensor in m.
        speed_noise: of the speed sensor in m/s; the filter assumes half as much again, for a wheel that slips.
        shares: of bandwidth, damping and integral action.
    """
    bandwidth = bandwidth_of(bandwidth_limits(controller, plant, timing, shares), shares)
    vehicle_mass = float(inertia(nominal_plant(controller.nominal, plant, controller.limits.preload).vehicle))
    gains = _law(controller, vehicle_mass, bandwidth, largest_speed_error, shares.integral)
    length, tension, stretches = plant.track.length / 2, controller.limits.preload / 2, []
    values = leaves(controller)
    for side in plant.sides:
        stretches.append(tension * length / float(tangent_rigidity(side.rope, tension, length, plant.track)))
        winch, radius = f"winch_{side.number}", side.winch.drum_radius
        lever = radius / side.winch.gear_ratio
        gains |= {
            f"{winch}.kp": TENSION_PROPORTIONAL * lever,
            f"{winch}.ki": shares.integral * TENSION_INTEGRAL * bandwidth * lever,
            f"{winch}.damping": shares.damping * drum_damping(side, controller, plant, timing) * radius * lever,
            f"{winch}.lead": LEAD * timing.drive,
        }
        if shares.fading:
            share = damped_length(side, controller, plant, timing) / plant.track.length
            gains[f"{winch}.fade"] = max(share, values.get(f"{winch}.fade", 0.0))
    gains |= {
        "kalman.bandwidth": 2 * bandwidth,
        "kalman.ramp": 0.2,
        "kalman.compensation": shares.integral,
        "kalman.encoder_noise": max(stretches) / 2,
    }
    if position_noise:
        gains["kalman.position_noise"] = position_noise
    if speed_noise:
        gains["kalman.speed_noise"] = 1.5 * speed_noise
    return with_leaves(controller, {key: value for key, value in gains.items() if key in values})


def _law(
    controller: Controller, mass: float, bandwidth: float, largest_speed_error: float, integral: float
) -> dict[str, float]:
    """Gains of the sliding-mode law and its observer (step 3)."""
    law = controller.law
    gains = law.nftsm if isinstance(law, FandoNftsm | Nftsm) else NftsmGains()
    ratio, stiffness = gains.p / gains.q, bandwidth**2
    slope = bandwidth * (ratio + math.sqrt(ratio**2 - ratio))  # y of y/ratio + kp/y = 2 w
    growth = slope**2 / (ratio * stiffness)  # of the surface's slope: the terminal one's has fallen by as much
    smoothing = largest_speed_error / math.sqrt(growth ** (2 / (ratio - 1)) - 1)
    reaching = stiffness / (1 + NftsmGains.eta * NftsmGains.phi / NftsmGains.k)
    acceleration = float(controller.limits.force) / mass
    return {
        "nftsm.linear_speed": LINEAR_SPEED,
        "nftsm.smoothing": smoothing,
        "nftsm.beta": slope * smoothing ** (ratio - 1),
        "nftsm.k": acceleration,
        "nftsm.phi": acceleration / reaching,
        "nftsm.eta": stiffness - reaching,
        "observer.l0": integral * OBSERVER * bandwidth,
        "observer.kf": integral * bandwidth,
    }
