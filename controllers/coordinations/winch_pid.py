"""Winch controller: feedforward and PID on the rope tension (paper Section 3.3, E9, E10), and damping of the drum.

The paper's controller has no damping: with a light drum and a massless rope, the damping of the rope suffices. A heavy
drum on a heavy rope oscillates at 5 to 90 Hz with a damping ratio of 0.4 to 4 %. ``damping`` makes the motor a damper
between the drum and the reference speed: a rope that ends in its own wave impedance, sqrt(E A mu), reflects no wave,
which as a motor torque per drum speed is sqrt(E A mu) R²/G.

- The lag of drive and computer shifts the phase of the damping: at the resonance of rotor and gearbox, 25 to 60 Hz,
  little of it is left. ``lead`` shifts the phase back, by (1 + s lead)/(1 + s lead/6).
- A rope that is short at its winch is so stiff that a heavy drum oscillates at 80 Hz and more, where the lag of drive
  and sampling turns damping and proportional gain into excitation: there both are reduced with the rope's length
  (``fade``).
- The reference speed is that of the drum while the vehicle keeps to its own. Where a push or a weak drive holds the
  vehicle back, the damping of that common motion is a force on it, and limited with the tension command. What is left,
  of the drum relative to the vehicle, damps the oscillation; it may reduce the torque below the lower limit of the
  tension, down to zero: a drum braked in one direction only would oscillate until its rope is slack.
- A drum that swings on its rope overshoots its command. A reference governor limits the command so that the tension
  predicted a quarter of a period ahead, where the speed of the stretch has become tension, is at most the largest
  (`governed`). Every later peak is a quarter of a period ahead at some time. The speed of the stretch is that of the
  drum, which takes up a slack rope, or of the measured tension, whichever is larger: after a jerk the rotor oscillates
  on its gearbox, and its encoder does not show how the drum moves. Therefore the command exceeds the tension by no more
  than the damping takes at the speed that becomes the largest tension, too.
- The tension command is shaped by the drum's resonance (`controllers.coordinations.command_shaping`) to the damping
  ratio ``shaping``, which the position law sees in place of the drum's own.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any

import annotated_types as at

from dualwinch.controllers.coordinations.command_shaping import DrumResonance, ShapedCommand, shaped
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.parts import Context
from dualwinch.model.quantities.part import NO_STATE
from dualwinch.model.quantities.quantity import Mark, NonNegative, Positive, Quantity, Tunable
from dualwinch.model.ropes import Track
from dualwinch.model.scalar import Scalar, clip, either, has_begun, maximum, minimum, present, where
from dualwinch.model.winch import Winch, total_inertia

LEVER = "plant.{table}.drum_radius/plant.{table}.gear_ratio"
"""Motor torque per tension: the scale of gains from tensions to torques."""


@dataclass(frozen=True)
class WinchGains:
    """PID gains of one winch."""

    kp: Annotated[NonNegative, Quantity("N m/N", "proportional gain", "A11"), Tunable(1e-5, 1e-2, of=LEVER)] = 5e-4
    ki: Annotated[NonNegative, Quantity("N m/(N s)", "integral gain", "A11"), Tunable(1e-3, 1, of=LEVER)] = 2e-2
    kd: Annotated[
        NonNegative,
        Quantity("N m s/N", "derivative gain", "A11"),
        Tunable(0, 1e-5, log=False, standard=False, of=LEVER),
        Mark.OFF_AT_ZERO,
    ] = 0.0
    damping: Annotated[
        NonNegative,
        Quantity("N m s/rad", "motor torque per deviation of the drum from the reference speed", "A15"),
        Tunable(1, 500, standard=False, of=LEVER + "*plant.{table}.drum_radius"),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    lead: Annotated[
        NonNegative,
        Quantity("s", "lead time of the damping, against the lag of drive and computer", "A15"),
        Tunable(1e-4, 1e-2, standard=False),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    shaping: Annotated[
        NonNegative,
        at.Le(2),
        Quantity("1", "damping ratio that shaping of the command gives the drum's resonance; 0: no shaping", "A15"),
        Tunable(0.3, 1.5, standard=False),
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    fade: Annotated[
        Positive,
        Quantity("1", "rope length over track length below which a damped winch reduces kp and damping", "A15"),
    ] = 0.05

    def on(self, length: Scalar, track: Track) -> "WinchGains":
        """The gains for a rope of a length in m."""
        if not present(self.damping):
            return self
        share = self.share(length, track)
        return replace(self, kp=share * self.kp, damping=share * self.damping)

    def initial_state(self) -> "WinchState":
        """An empty integral, and the state of the command's shaping where there is one."""
        return WinchState(shaped=ShapedCommand() if present(self.shaping) else NO_STATE)

    def share(self, length: Scalar, track: Track) -> Scalar:
        """Share of the gains of a damped winch on a rope of a length in m."""
        return minimum(length / (self.fade * track.length), 1.0)


@dataclass(frozen=True)
class DrumMotion:
    """How a drum turns.

    Attributes:
        alpha_d: acceleration of the reference in rad/s².
        slip: speed beyond that of the reference in rad/s.
        drift: the same of a drum that turns with the vehicle.
        impedance: tension in N per rad/s that the speed of the drum relative to the vehicle becomes within a quarter of
            a period, ``sqrt(k m) R`` with the rope's stiffness k and the mass m that moves.
        frequency: of the drum on its taut rope in rad/s, ``sqrt(k/m)``.
    """

    alpha_d: Scalar = 0.0
    slip: Scalar = 0.0
    drift: Scalar = 0.0
    impedance: Scalar = 0.0
    frequency: Scalar = math.inf


@dataclass(frozen=True)
class WinchState:
    """State of one winch controller."""

    integral: Annotated[Scalar, Quantity("N s", "integral of the tension error")] = 0.0
    error_previous: Annotated[Scalar, Quantity("N", "tension error of the last sample")] = 0.0
    primed: Annotated[Scalar, Quantity("1", "0 at the first sample, then 1")] = 0.0
    slip: Annotated[Scalar, Quantity("rad/s", "low-passed drum speed beyond that of the reference")] = 0.0
    tension: Annotated[Scalar, Quantity("N", "low-passed measured tension")] = 0.0
    shaped: Any = NO_STATE


def winch_step(
    state: WinchState,
    command: Scalar,
    tension: Scalar,
    motion: DrumMotion,
    winch: Winch,
    gains: WinchGains,
    context: Context,
    drum: DrumResonance | None = None,
) -> tuple[WinchState, Scalar, Scalar]:
    """One sample of a winch controller (paper Section 3.3): next state, motor torque in N m, 1 where it is saturated.

    The torque's limits follow from those of the tension. The integral is held where torque or command is limited: a
    drive without torque would wind it up. The lower limit does not apply to damping.

    Command and measured tension are in N. The feedforward is that of the reference's acceleration (E9: the measured one
    would close an algebraic loop). `drum` is the resonance by which the command is shaped, where it is.
    """
    limits, sample_time = context.limits, context.sample_time
    to_torque = winch.drum_radius / winch.gear_ratio
    shape = state.shaped
    if drum is not None:
        shape, command = shaped(shape, command, drum, gains.shaping, sample_time, state.primed)
    slow, stretching, level, demand = state.slip, 0.0, state.tension, command
    if present(gains.damping):
        ahead, slow = _ahead(slow, motion.slip, gains.lead, sample_time)
        stretching = ahead - motion.drift
        before = where(has_begun(state.primed), level, tension)
        swing, level = _swing(before, tension, motion, sample_time)
        damping = gains.damping / to_torque
        demand = command - damping * motion.drift
        share = damping / maximum(damping, motion.impedance)
        friction = winch.coulomb_friction / winch.drum_radius
        command = governed(demand, tension, swing, share, limits, friction)
    error = command - tension
    integral = state.integral + sample_time * error
    slope = state.primed * (error - state.error_previous) / sample_time
    feedforward = to_torque * command + total_inertia(winch) / winch.gear_ratio * motion.alpha_d
    unlimited_torque = feedforward + gains.kp * error + gains.ki * integral + gains.kd * slope
    torque = clip(unlimited_torque, to_torque * limits.tension_min, to_torque * limits.tension_max)
    saturated = limitation = torque != unlimited_torque
    if present(gains.damping):
        limitation = either(saturated, command != demand)
        torque = clip(torque - gains.damping * stretching, 0.0, to_torque * limits.tension_max)
    clamped_integral = state.integral + sample_time * where(limitation, 0.0, error)
    return WinchState(clamped_integral, error, 1.0, slow, level, shape), torque, saturated


def governed(
    command: Scalar, tension: Scalar, swing: Scalar, share: Scalar, limits: Limits, friction: Scalar = 0.0
) -> Scalar:
    """A tension command in N within its limits that the drum does not make exceed the largest tension.

    Reference governor (Garone, Di Cairano and Kolmanovsky, Automatica 75, 2017, 306-328) of the drum on its rope.

    - On a taut rope the tension under a constant command c is ``F(t) = c + (F - c) cos(wt) + swing sin(wt)`` with the
      rate of the tension over w as `swing` in N: a quarter of a period ahead ``c + swing``. The drum's damping, left
      out here, makes it less.
    - A drum that takes up a slack rope reaches the speed at which its damping takes ``c - F - friction``. `share` is
      the damping over the drum's impedance: ``F + (c - F - friction)/share`` is the tension once that speed has become
      tension.

    Example:
        >>> limits = Limits(tension_max=6000.0)
        >>> [governed(5500.0, 3000.0, swing, 1.0, limits) for swing in (0.0, 1000.0, -1000.0)]
        [5500.0, 5000.0, 5500.0]
        >>> [governed(5500.0, tension, 0.0, 0.25, limits) for tension in (0.0, 3000.0)]
        [1500.0, 3750.0]
    """
    taken_up = tension + friction + share * (limits.tension_max - tension)
    largest = minimum(limits.tension_max - maximum(swing, 0.0), taken_up)
    largest = clip(largest, limits.tension_min, limits.command_max)
    return clip(command, limits.tension_min, largest)


SMOOTHING = 0.25
"""Time constant of the low-pass from which the rate of a tension is taken, over 1/w of the drum on its rope."""


def _swing(level: Scalar, tension: Scalar, motion: DrumMotion, sample_time: float) -> tuple[Scalar, Scalar]:
    """Tension in N that the speed of the stretch becomes a quarter of a period ahead, and the low-passed tension.

    The larger of ``Z ds/dt``, by the drum's speed relative to the vehicle, and ``dF/dt/w``, by the measured tension.
    """
    rise = (tension - level) / (SMOOTHING + motion.frequency * sample_time)
    return maximum(motion.impedance * (motion.slip - motion.drift), rise), tension - SMOOTHING * rise


LEAD_RATIO = 6.0
"""Corner frequency of the lead's pole over that of its zero."""


def _ahead(slow: Scalar, slip: Scalar, lead: Scalar, sample_time: float) -> tuple[Scalar, Scalar]:
    """The slip with a phase lead, (1 + s lead)/(1 + s lead/6) by backward Euler, and the low-passed slip."""
    if not present(lead):
        return slip, slow
    slow += sample_time / (lead / LEAD_RATIO + sample_time) * (slip - slow)
    return slip + (LEAD_RATIO - 1.0) * (slip - slow), slow
