"""What a public log of a servo drive says of its inertia, friction and lag, beside what its authors found.

The Electro-Mechanical Positioning System (Janot, Gautier and Brunot, Data Set and Reference Models of EMPS, Workshop on
Nonlinear System Identification Benchmarks, 2019; nonlinearbenchmark.org): a motor moves a carriage on a ball screw, its
encoder and its voltage are logged. To the model here it is a winch without a rope: ``python -m benchmarks.servo DIR``
fits a winch's numbers to both logs in a folder (DATA_EMPS.mat, DATA_EMPS_PULSES.mat). The authors' method, least
squares of the filtered inverse model, reads the same logs beside it; ``--write`` puts the table into a document.
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.signal import butter, decimate, sosfiltfilt

from benchmarks.document import command, markdown, publish
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification.identify import identify
from dualwinch.toolboxes.identification.log import Log, log
from dualwinch.toolboxes.identification.options import DEFAULTS, DataSheetOptions
from dualwinch.toolboxes.identification.result import IdentificationResult

Floats = NDArray[np.float64]

LOGS = ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")
"""Without and with pulses of voltage."""

PINION = 0.01
"""Radius in m of the pinion at which carriage and force are expressed as angle, inertia and torque."""

SHAFT = 1e-4
"""Radius in m of the drum: next to nothing, for no rope is on it."""

KEYS = tuple(f"plant.winch_1.{name}" for name in ("inertia", "coulomb_friction", "viscous_friction"))
LAG = "actuator.motor.time_constant"

BEGIN = dict(zip(KEYS, (0.008, 0.1, 0.01), strict=True)) | {LAG: 0.002}
"""Nominal values, from which the search starts: 80 kg, 10 N, 100 N s/m and 2 ms."""

UNRECORDED = 1.0
"""Torque over the recorded one that the model may lack: the table says how much that is."""

SPEEDS = (0.035, 0.1)
"""Speeds in m/s at which friction is compared."""

PASS, STRIDE = 100.0, 10
"""The authors' low pass in Hz, and of how many samples one is kept."""

HEADINGS = ("", "no pulses, no lag", "pulses, no lag", "pulses, with lag")


@dataclass(frozen=True)
class Drive:
    """A log: time in s, position in m, force in N; (samples,) each."""

    t: Floats
    q: Floats
    force: Floats

    @property
    def log(self) -> Log:
        """As one of winch 1, which pays out; nothing drives winch 2."""
        torque, angle = -PINION * self.force, -self.q / PINION
        return log({"t": self.t, "tau_1": torque, "tau_2": np.zeros_like(torque), "theta_1": angle})

    def inverse(self) -> Floats:
        """Mass in kg, viscous (N s/m) and Coulomb friction (N) and offset (N), by the authors' method."""
        step = float(np.mean(np.diff(self.t)))
        speed = np.gradient(sosfiltfilt(butter(4, PASS, fs=1 / step, output="sos"), self.q), step)
        columns = np.array([np.gradient(speed, step), speed, np.sign(speed), np.ones_like(speed), self.force])
        kept = decimate(columns[:, 50:-50], STRIDE, ftype="fir", axis=1)
        return np.linalg.lstsq(kept[:-1].T, kept[-1], rcond=None)[0]


def drive(file: Path) -> Drive:
    """A log of the benchmark.

    Raises:
        ConfigurationError: it is not one.
    """
    try:
        data = loadmat(file, variable_names=["t", "qm", "vir", "gtau"])
        t, q, voltage, gain = (np.asarray(data[name], float).ravel() for name in ("t", "qm", "vir", "gtau"))
    except (OSError, ValueError, KeyError) as error:
        raise ConfigurationError(f"{file}: is no log of this benchmark: {error}") from None
    return Drive(t, q, float(gain[0]) * voltage)


def fitted(drive: Drive, *, lag: bool) -> IdentificationResult:
    """Numbers of a winch; with the motor's lag or without.

    Raises:
        ConfigurationError: no such winch does what the log says.
    """
    settings = {f"plant.winch_1.{name}": value for name, value in (("gear_ratio", 1.0), ("drum_radius", SHAFT))}
    settings |= {"actuator.kind": "motor"} if lag else {}
    keys = (*KEYS, LAG) if lag else KEYS
    nominal = override(Experiment(), settings | {key: BEGIN[key] for key in keys})
    # the log's force defines the unit of mass, as in the authors' method: the torque constant has no error
    options = replace(DEFAULTS, data_sheet=DataSheetOptions(torque_error=0.0))
    return identify(drive.log, keys, nominal, unrecorded=UNRECORDED, options=options)


def column(drive: Drive, found: IdentificationResult) -> list[str]:
    """What is told of a fit, row by row of `table`."""
    value, deviation = (dict(zip(found.keys, each.tolist(), strict=True)) for each in (found.values, found.deviations))
    mass, viscous, coulomb, _ = drive.inverse()
    inertia, coulomb_key, viscous_key = KEYS
    of_radius = 1 / PINION**2

    def friction(speed: float) -> float:
        return value[coulomb_key] / PINION + value[viscous_key] * of_radius * speed

    torque = np.sqrt(np.mean(np.square(PINION * drive.force)) / 2)  # of both winches, of which one is at rest
    return [
        f"{value[inertia] * of_radius:.2f} ± {deviation[inertia] * of_radius:.2f}",
        f"{mass:.2f}",
        f"{value[LAG] * 1e3:.3f} ± {deviation[LAG] * 1e3:.3f}" if LAG in value else "",
        *(f"{friction(speed):.1f} / {coulomb + viscous * speed:.1f}" for speed in SPEEDS),
        f"{found.process_noise['torque_1'].deviation / torque:.0%}",
        "yes" if found.converged else "no",
    ]


def table(folder: Path) -> str:
    """All fits.

    Raises:
        ConfigurationError: a log that is missing or none.
    """
    plain, pulsed = (drive(folder / name) for name in LOGS)
    columns = []
    for heading, each, lag in zip(HEADINGS[1:], (plain, pulsed, pulsed), (False, False, True), strict=True):
        print(f"fitting: {heading}", file=sys.stderr)
        columns.append(column(each, fitted(each, lag=lag)))
    names = [
        "moved mass (kg)", "by the authors' method (kg)", "motor's lag (ms)",
        *(f"friction at {speed:g} m/s, found / by the authors' method (N)" for speed in SPEEDS),
        "unrecorded torque, over the recorded one", "converged",
    ]  # fmt: skip
    return markdown(HEADINGS, list(zip(names, *columns, strict=True)))


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; 0 done, 1 where there is nothing to read."""
    parser = command(__doc__)
    parser.add_argument("folder", type=Path, help=f"folder with {' and '.join(LOGS)}")
    options = parser.parse_args(arguments)
    try:
        publish(options.write, {"servo": table(options.folder)})
    except ConfigurationError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
