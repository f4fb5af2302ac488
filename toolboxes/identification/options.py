"""Options of an estimation: the method's own numbers, with unit, meaning and range."""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Ge, Gt, Lt

from dualwinch.toolbox import Quantity, quantities, tree

Factor = Annotated[float, Gt(1)]
Share = Annotated[float, Gt(0), Lt(1)]
Count = Annotated[int, Ge(1)]


@dataclass(frozen=True)
class ResamplingOptions:
    """Resampling of logs at the samples of the filter."""

    min_rows: Annotated[int, Ge(2), Quantity("1", "least number of rows of a log")] = 200
    max_gap: Annotated[
        quantities.Positive, Quantity("s", "longest gap in the torques that their last value bridges")
    ] = 0.1
    repeats: Annotated[int, Ge(2), Quantity("1", "number of equal readings at which a sensor counts as silent")] = 20
    standstill_speed: Annotated[quantities.Positive, Quantity("m/s", "speed below which the machine stands still")] = (
        0.05
    )
    window: Annotated[
        quantities.Positive,
        Quantity("s", "time of averages of speed, chatter, pulls, innovations; of first readings"),
    ] = 0.5
    min_move_time: Annotated[quantities.Positive, Quantity("s", "shortest interval of motion that is used")] = 2.0
    between_rows: Annotated[
        bool, Quantity("", "whether torques between rows are at a mean of several, not held from row to row")
    ] = False
    torque_rows: Annotated[Count, Quantity("1", "rows of that mean")] = 12
    min_chatter: Annotated[Share, Quantity("1", "least size of the chatter, over its RMS in the log")] = 0.1


@dataclass(frozen=True)
class InitialStateOptions:
    """Standard deviations of the initial state, before the first reading."""

    position: Annotated[quantities.Positive, Quantity("m", "position of vehicle and drums together")] = 5e-3
    speed: Annotated[quantities.Positive, Quantity("m/s", "speed of vehicle and drums, together and of each drum")] = (
        0.02
    )
    share: Annotated[
        quantities.Positive, Quantity("1", "stretch and sag of each rope and torque of each motor, as shares of them")
    ] = 0.2


@dataclass(frozen=True)
class NoiseOptions:
    """Estimation of measurement noise R and process noise Q: initial values, ranges and accuracy."""

    resolution: Annotated[
        quantities.Positive,
        Quantity(
            "m",
            "least noise of position and drums, of speeds per second, and of tensions and unrecorded forces, which go "
            "up to the largest tension, as a share of that",
        ),
    ] = 1e-6
    force_time: Annotated[quantities.Positive, Quantity("s", "correlation time of the unrecorded force")] = 1.0
    torque_time: Annotated[quantities.Positive, Quantity("s", "correlation time of the unrecorded torques")] = 0.05
    vortex_time: Annotated[
        quantities.Positive, Quantity("s", "correlation time of vortices with an integrated phase, which is lasting")
    ] = 1e4
    vortex_time_factor: Annotated[
        float, Ge(1), Quantity("1", "prior deviation of `vortex_time`, as a factor; 1: known")
    ] = 30.0
    min_chatter: Annotated[
        quantities.NonNegative, Quantity("1", "least unrecorded torque over the chatter between rows; 0: no chatter")
    ] = 0.0
    grid: Annotated[Factor, Quantity("1", "factor between points of a grid, and reach of a line search")] = 30.0
    tolerance: Annotated[
        quantities.Positive, Quantity("1", "accuracy of the logarithm of a deviation or time by a rough search")
    ] = 0.1
    max_evaluations: Annotated[Count, Quantity("1", "largest number of steps of a rough search in one of them")] = 7
    described_factor: Annotated[
        float,
        Ge(1),
        Quantity("1", "prior deviation of size and correlation time of current and rail load, as a factor; 1: known"),
    ] = 2.0
    whole_range: Annotated[
        bool, Quantity("", "search over the whole reach each time (Brent's method), not from where noise is")
    ] = False
    section_time: Annotated[
        quantities.Positive, Quantity("s", "time at the start of each section used by a rough search")
    ] = 10.0


@dataclass(frozen=True)
class DataSheetOptions:
    """Standard deviations of what data sheets promise of sensors and motors; 0: perfect.

    They are estimated along as nuisance parameters with normal priors of these deviations, so that every interval
    contains them.
    """

    load_cell_error: Annotated[quantities.NonNegative, Quantity("1", "gain of each load cell, relative")] = 0.01
    load_cell_zero: Annotated[
        quantities.NonNegative, Quantity("1", "zero of each load cell, over its full scale, the limit of the tension")
    ] = 0.01
    torque_error: Annotated[quantities.NonNegative, Quantity("1", "torque constant of each motor, relative")] = 0.02
    speed_error: Annotated[quantities.NonNegative, Quantity("1", "scale of the speed wheel, relative")] = 0.002
    clock_rate: Annotated[
        quantities.NonNegative,
        Quantity("1", "rate of a recorder with a clock of its own, relative"),
    ] = 2e-5


@dataclass(frozen=True)
class CoarseLogOptions:
    """Replacements of other options if torques changed more often than they were logged.

    The unrecorded torques then represent chatter: white, and relative to the size of the logged torques' chatter. As
    chatter is not white, the likeliest noise explains too much: Q is estimated before the first Newton steps only.
    """

    min_spacing: Annotated[Factor, Quantity("samples", "time between rows from which this is considered")] = 1.5
    chatter_time: Annotated[Share, Quantity("samples", "correlation time of the chatter")] = 0.2
    min_chatter: Annotated[quantities.Positive, Quantity("1", "least chatter, over that of the logged torques")] = 0.7


@dataclass(frozen=True)
class SearchOptions:
    """The search for the maximum of the likelihood (`identification.estimate.PredictionErrorMethod`)."""

    considerable: Annotated[
        quantities.Positive,
        Quantity(
            "1",
            "rise of deviance or criterion up to which another value or model has considerable support",
            "Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773",
        ),
    ] = 10.0
    outlier: Annotated[
        quantities.Positive,
        Quantity("1", "innovation, in deviations, beyond which a reading counts less", "Huber (1964)"),
    ] = 4.0
    range_factor: Annotated[Factor, Quantity("1", "range of a parameter, in its scale or prior deviation")] = 10.0
    length: Annotated[
        quantities.Positive,
        Quantity("m", "scale of a length or of an encoder's zero that is zero by default"),
    ] = 1e-3
    share: Annotated[quantities.Positive, Quantity("1", "scale of a share that is zero by default")] = 0.01
    nuisance_share: Annotated[
        float, Ge(0), Quantity("1", "prior deviation of inertias as additional parameters; 0: none are estimated")
    ] = 0.3
    strouhal_share: Annotated[
        quantities.Positive, Quantity("1", "prior deviation of the Strouhal number, likewise")
    ] = 0.1
    amplitude_share: Annotated[
        quantities.Positive,
        Quantity("1", "prior deviation of the vortices' amplitude, likewise, unless logs contradict that"),
    ] = 0.05
    coarse: CoarseLogOptions = field(default_factory=CoarseLogOptions)
    delay_significance: Annotated[
        Factor, Quantity("1", "significance of another delay, over that of the described one, from which it is used")
    ] = 3.0
    drum_friction: Annotated[
        quantities.Positive,
        Quantity("1", "assumed drum friction if none is described, over the largest torque of the rope"),
    ] = 0.02
    current_sigma: Annotated[quantities.Positive, Quantity("m/s", "assumed current if no sea is described")] = 0.05
    normal_force_sigma: Annotated[quantities.Positive, Quantity("1", "assumed rail load, likewise, over the mean")] = (
        0.1
    )
    max_delay_samples: Annotated[int, Ge(0), Quantity("samples", "largest considered delay of the torques")] = 4
    cautious_rounds: Annotated[
        Count,
        Quantity("1", "first rounds, with narrow ranges and fixed noise; as many without progress are the last"),
    ] = 3
    max_evaluations: Annotated[
        Count, Quantity("1", "largest number of evaluations of derivatives with fixed gains")
    ] = 5
    max_iterations: Annotated[Count, Quantity("1", "largest number of rounds, of steps of scoring, and of polls")] = 60
    reach: Annotated[
        quantities.Positive,
        Quantity("1", "deviations of a prior, or of an estimate, within which a search looks around first"),
    ] = 3.0
    accuracy: Annotated[
        quantities.Positive,
        Quantity("1", "distance, in deviations, at which no neighbour of a maximum is likelier"),
    ] = 0.1


@dataclass(frozen=True)
class VortexOptions:
    """The search for the time origin of vortices in a log that begins in motion."""

    smoothing: Annotated[
        quantities.Positive, Quantity("s", "standard deviation of the Gaussian that smooths readings")
    ] = 0.3
    max_time_before: Annotated[quantities.Positive, Quantity("s", "longest considered time before the log")] = 120.0
    phase_step: Annotated[quantities.Positive, Quantity("rad", "step of the phase at the largest speed")] = 0.1
    strouhal_points: Annotated[Count, Quantity("1", "number of Strouhal numbers in that range")] = 41


@dataclass(frozen=True)
class DiagnosticsOptions:
    """Diagnostics of an estimate."""

    lags: Annotated[Count, Quantity("samples", "lags of the correlations of innovations")] = 50
    confidence: Annotated[Share, Quantity("1", "confidence of a whiteness test over all lags", "Bonferroni")] = 0.99
    negligible_correlation: Annotated[Share, Quantity("1", "correlation that is neglected even if significant")] = 0.05
    correlated: Annotated[Share, Quantity("1", "correlation of two estimates from which it is reported")] = 0.9
    blocks: Annotated[int, Ge(2), Quantity("1", "time blocks per section for the sandwich covariance")] = 20
    profile_points: Annotated[Count, Quantity("1", "points of a profile likelihood on each side")] = 4


@dataclass(frozen=True)
class PlausibilityOptions:
    """Limits beyond which a log is refused as another machine's."""

    improbable: Annotated[
        Share, Quantity("1", "probability by its prior below which the estimate of a nuisance parameter is refused")
    ] = 1e-6
    max_unrecorded: Annotated[
        quantities.Positive,
        Quantity("1", "unrecorded torque or force, over the recorded one, from which a fit is refused"),
    ] = 0.1
    max_noise_ratio: Annotated[
        Factor, Quantity("1", "noise of a sensor, over its jumps, from which a fit is refused")
    ] = 50.0
    max_excess: Annotated[
        quantities.Positive,
        Quantity(
            "1", "plausible distance beyond the track, and push of a rope, over its length and the largest tension"
        ),
    ] = 0.2
    max_scale_ratio: Annotated[
        Factor, Quantity("1", "ratio of the distances by two sensors, or its inverse, that is refused")
    ] = 2.0
    min_correlation: Annotated[
        Share, Quantity("1", "correlation of these distances below which their ratio is not used")
    ] = 0.8
    min_distance: Annotated[
        quantities.Positive, Quantity("1", "deviation of a distance, over the track, below which it is not used")
    ] = 0.01
    max_tension_ratio: Annotated[Factor, Quantity("1", "plausible tension, over the controller's limit")] = 10.0
    max_step_ratio: Annotated[
        Factor, Quantity("1", "time between two rows, over the sample time or inverse, that is refused")
    ] = 500.0


@dataclass(frozen=True)
class ExcitationOptions:
    """The search for the motion with the most informative log."""

    time_per_move: Annotated[quantities.Positive, Quantity("s", "mean time of a move")] = 8.0
    max_moves: Annotated[Count, Quantity("1", "largest number of moves")] = 12
    min_speed_share: Annotated[Share, Quantity("1", "least speed and acceleration, over the largest")] = 0.3
    jerk_time: Annotated[
        quantities.Positive, Quantity("s", "rise time of the acceleration without a limit of jerk")
    ] = 0.5
    force_share: Annotated[Share, Quantity("1", "share of the ropes' largest net force that accelerates")] = 0.5
    max_slack_share: Annotated[Share, Quantity("1", "share of a run in which a rope may be slack")] = 5e-3
    max_overshoot: Annotated[quantities.Positive, Quantity("1", "allowed relative overshoot of the speed")] = 0.05
    sigma: Annotated[Share, Quantity("1", "initial step size of CMA-ES, over each range")] = 0.3
    max_trials: Annotated[Count, Quantity("1", "number of simulated motions without a time limit")] = 200
    min_duration: Annotated[quantities.Positive, Quantity("s", "shortest run")] = 5.0
    max_duration: Annotated[quantities.Positive, Quantity("s", "longest run")] = 3600.0


@dataclass(frozen=True)
class EstimationOptions:
    """All options of `identify` and `excite`, group by group; the defaults suit logs of one winch pair at 1 kHz.

    Raises:
        ConfigurationError: a value of the wrong type or out of its range.
    """

    resampling: ResamplingOptions = field(default_factory=ResamplingOptions)
    initial_state: InitialStateOptions = field(default_factory=InitialStateOptions)
    noise: NoiseOptions = field(default_factory=NoiseOptions)
    search: SearchOptions = field(default_factory=SearchOptions)
    data_sheet: DataSheetOptions = field(default_factory=DataSheetOptions)
    vortices: VortexOptions = field(default_factory=VortexOptions)
    diagnostics: DiagnosticsOptions = field(default_factory=DiagnosticsOptions)
    plausibility: PlausibilityOptions = field(default_factory=PlausibilityOptions)
    excitation: ExcitationOptions = field(default_factory=ExcitationOptions)

    def __post_init__(self) -> None:
        tree.check_values(self, "options.")


DEFAULTS = EstimationOptions()
