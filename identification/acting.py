"""What acted on the vehicle and nobody recorded, by all readings, those that came later among them."""

import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.fit import Fit, Fitting
from dualwinch.identification.force import Force
from dualwinch.identification.log import Log
from dualwinch.identification.predictor import state_template
from dualwinch.identification.sections import whole_section
from dualwinch.identification.unrecorded import NAMES
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.vehicle import drag, friction

Floats = NDArray[np.float64]

EVERY = 0.01
"""Time in s from one value of a force to the next: it changes within a second."""

STEP = 1e-4
"""Change of a current in m/s whose effect gives a slope."""


def force_of(fitting: Fitting, log: Log, fit: Fit) -> Force:
    """The force on the vehicle over a log.

    Args:
        fitting: of the logs.
        log: one of them.
        fit: what came of it.

    Raises:
        KeyboardInterrupt: interrupted.
    """
    experiment, filters = fit.experiment, fitting.others([whole_section(log, fit.experiment)])
    ((states, acting, spreads),) = filters.smooth(experiment, fit.levels)
    (section,), vehicle = filters.sections, experiment.plant.vehicle
    rows = slice(None, None, max(1, round(EVERY / experiment.simulation.sample_time)))
    v = states[rows, list(leaves(state_template(fitting.structure))).index("motion.plant.v")]
    current, load, force = (acting[rows, NAMES.index(name)] for name in NAMES[:3])

    def resistance(current: Floats, load: Floats) -> Floats:
        pairs = zip(v.tolist(), current.tolist(), load.tolist(), strict=True)
        return np.array([friction(v, vehicle, load) + drag(v - current, vehicle) for v, current, load in pairs], float)

    none = np.zeros_like(v)
    here = resistance(current, load)
    slopes = np.column_stack([
        (here - resistance(current + STEP, load)) / STEP, here - resistance(current, load + 1), none + 1,
    ])  # fmt: skip
    variance = np.einsum("ki,kij,kj->k", slopes, spreads[rows, :3, :3], slopes)
    return Force(
        log=log.name,
        t=section.inputs[rows, 0],
        force=force + resistance(none, none) - here,
        deviation=np.sqrt(np.maximum(variance, 0.0)),
    )
