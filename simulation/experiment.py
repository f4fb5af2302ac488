"""An experiment: plant, controller, reference, disturbances, sensors and simulation settings."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal, TypeAlias, get_args

import annotated_types as at

from dualwinch.controllers.controller import Controller
from dualwinch.model.actuators import ACTUATORS, Actuator, Ideal
from dualwinch.model.disturbance import Disturbance
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.part import PartChoice
from dualwinch.model.quantities.quantity import Mark, NonNegative, Positive, Quantity, Rule
from dualwinch.model.quantities.tree import check_values
from dualwinch.model.reference import Reference, own_duration, steady_window
from dualwinch.simulation.metrics.metric import Metric
from dualwinch.simulation.metrics.metrics import checked_metrics
from dualwinch.simulation.metrics.recovery import METRICS
from dualwinch.simulation.sensors import Sensors

IntegratorName: TypeAlias = Literal["adaptive", "exponential", "rk4", "verlet"]

EngineName: TypeAlias = Literal["compiled", "casadi", "interpreter"]
ENGINES: tuple[EngineName, ...] = get_args(EngineName)
"""``compiled``: C by the emitter of `codegen.source`, which rewrites the step with fewer operations. ``casadi``: C as
CasADi's code generator writes it. Both run the whole run in one call of the same driver. ``interpreter``: CasADi's
virtual machine, one call per sample."""


@dataclass(frozen=True)
class Simulation:
    """Settings of the simulation: timing, integrator, engine, seed."""

    sample_time: Annotated[
        Positive, at.Le(0.1), Quantity("s", "sampling period of the controller", "assumption"), Mark.TIMING
    ] = 1e-3
    duration: Annotated[
        float | None,
        at.Gt(0),
        Quantity(
            "s",
            "length of the run, rounded to whole samples (default: uniform 25, profile 50, else that of the motion)",
            "paper 4.1",
        ),
        Mark.TIMING,
    ] = None
    delay_samples: Annotated[
        int,
        at.Ge(0),
        at.Le(100),
        Quantity("1", "delay of torque commands to the motors, in samples", "assumption"),
        Mark.SHAPES_CODE,
    ] = 0
    torque_step: Annotated[
        NonNegative,
        Quantity("N m", "quantisation step of torque commands; 0: none", "0.1 % of rated, CiA 402"),
        Mark.OFF_AT_ZERO,
        Mark.READS_IN_STEPS,
    ] = 0.0
    jitter: Annotated[
        NonNegative,
        at.Le(0.05),
        Quantity("s", "largest time a sample is early or late, drawn uniformly; unknown to controllers", "assumption"),
        Mark.OFF_AT_ZERO,
        Mark.SCALES_DRAWS,
        Mark.SHAPES_CODE_AT_ZERO,
    ] = 0.0
    integrator: Annotated[
        IntegratorName,
        Quantity("", "integration method; adaptive: exponential, in one step per sample where that is enough", ""),
    ] = "adaptive"
    substeps: Annotated[
        int,
        at.Ge(1),
        at.Le(256),
        Quantity("1", "integration steps per sample (adaptive: at least, where one step is not enough)", ""),
        Mark.SHAPES_CODE,
    ] = 5
    engine: Annotated[
        EngineName,
        Quantity("", "C by dualwinch's emitter, C by CasADi's code generator, or CasADi's interpreter", ""),
    ] = "compiled"
    readings: Annotated[
        bool, Quantity("", "whether rows include sensor readings (x_read, F1_read, ...), as a logger's do", "")
    ] = False
    seed: Annotated[
        int, at.Ge(0), at.Lt(2**64), Quantity("", "seed of every random signal of the run", ""), Mark.DRAWN_AHEAD
    ] = 0

    rules: ClassVar = (
        Rule(
            ("jitter", "sample_time"),
            lambda simulation: 2 * simulation.jitter < simulation.sample_time,
            lambda simulation, _: f"must be < {simulation.sample_time / 2:g} s (half a sample_time)",
        ),
    )


@dataclass(frozen=True)
class Experiment:
    """All values that determine a run; the defaults are the paper's Case 2."""

    plant: Plant = field(default_factory=Plant)
    controller: Controller = field(default_factory=Controller)
    reference: Reference = field(default_factory=Reference)
    disturbance: Disturbance = field(default_factory=Disturbance)
    sensors: Sensors = field(default_factory=Sensors)
    actuator: Annotated[
        Actuator,
        Quantity("", "model between torque command and motor torque", "assumption"),
        PartChoice("actuator.kind", ACTUATORS, "actuator"),
    ] = field(default_factory=Ideal)
    simulation: Simulation = field(default_factory=Simulation)
    metrics: Annotated[
        Sequence[Metric],
        Quantity("", "figures of merit in addition to the built-in ones"),
        PartChoice("metrics", METRICS, "metrics", several=True),
    ] = ()

    def __post_init__(self) -> None:
        """Raise `ConfigurationError` for a value of the wrong type or out of its range."""
        object.__setattr__(self, "metrics", checked_metrics(self.metrics))
        check_values(self)

    @property
    def duration(self) -> float:
        """Length of the run in s: as given, else that of the reference."""
        duration = self.simulation.duration
        return own_duration(self.reference) if duration is None else duration

    @property
    def samples(self) -> int:
        """Number of control samples of the run."""
        return round(self.duration / self.simulation.sample_time)

    @property
    def steady_window(self) -> tuple[float, float]:
        """First and last time in s of the steady state (A13)."""
        return steady_window(self.reference, self.duration)
