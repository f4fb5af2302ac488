"""Errors of sensors and motors by their data sheets, where the logs do not calibrate them."""

from dataclasses import replace

import numpy as np
import pytest

from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification.estimate import PredictionErrorMethod, with_data_sheets
from dualwinch.toolboxes.identification.options import DEFAULTS, DataSheetOptions
from dualwinch.toolboxes.identification.resample import sections_of
from dualwinch.toolboxes.identification.unknowns import covariance_of, data_sheet_parameters, unknown_parameters
from tests.toolboxes.identification.conftest import logged, machine

KEY = "plant.vehicle.mass"


@pytest.mark.slow
def test_considered_errors_widen_an_interval_by_as_much_as_they_move_the_estimate() -> None:
    sheet = replace(DataSheetOptions(**dict.fromkeys(vars(DEFAULTS.data_sheet), 0.0)), torque_error=0.01)
    options = replace(DEFAULTS, data_sheet=sheet)
    right = machine(simulation__duration=12.0)
    sections, unknowns = sections_of([logged(right)], right), unknown_parameters([KEY], right, {})
    start = np.array([leaves(right)[KEY]])
    method = PredictionErrorMethod(sections, right, unknowns, options)
    alone = method.run(start)
    wider, considered = with_data_sheets(method, alone, {"F1", "F2"}, calibrated=False)
    assert [each.key for each in wider.unknowns[1:]] == [f"plant.winch_{side}.torque_error" for side in (1, 2)]
    np.testing.assert_allclose(considered.values[1:], 0.0)
    moves = [
        PredictionErrorMethod(sections, override(right, {each.key: 0.01}), unknowns, options)
        .run(considered.values[:1], noise=considered.noise)
        .values[0]
        - considered.values[0]
        for each in wider.unknowns[1:]
    ]
    total = covariance_of(considered.information, wider.unknowns)[0, 0]
    known = covariance_of(alone.information, unknowns)[0, 0]
    assert np.sqrt(total - known) == pytest.approx(np.linalg.norm(moves), rel=0.1)


def test_data_sheets_name_sensors_that_are_recorded_and_both_motors() -> None:
    keys = {each.key for each in data_sheet_parameters((), machine(), {"x", "F2"})}
    assert keys == {
        "plant.winch_1.torque_error",
        "plant.winch_2.torque_error",
        "sensors.load_cell_error_2",
        "sensors.load_cell_zero_2",
    }
