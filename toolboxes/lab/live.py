"""The run of a served plant in the lab's page, which requests new rows while the run proceeds."""

import json
from collections.abc import Callable, Mapping
from typing import Any

from dualwinch.simulation.experiment import Experiment
from dualwinch.toolboxes.lab.assemble import MOST_NUMBERS, differences, encoded
from dualwinch.toolboxes.server.plant import ServedPlant

ADDRESS = "live"
"""Path of the requests, below the page's address."""


def live_run(experiment: Experiment) -> dict[str, Any]:
    """A live run with the settings of an experiment, in place of `assemble.own_run`."""
    return {"label": "the served plant", "live": ADDRESS, "settings": differences(experiment)}


def live_rows(plant: ServedPlant) -> Callable[[Mapping[str, int]], str]:
    """Function that answers the page's requests with JSON.

    A request gives the number of the page's ``run`` and of its ``rows``; the answer has the number of the present run,
    its further rows as columns, and a status in words while safe torques are in force. Rows of long runs are thinned.
    """
    samples, columns = plant.experiment.samples, len(plant.rows(0, 1)[1])
    stride = max(1, -(-samples * columns // MOST_NUMBERS))

    def answer(request: Mapping[str, int]) -> str:
        number, rows = plant.rows(max(0, request.get("rows", 0)) * stride, stride)
        if number != request.get("run"):
            number, rows = plant.rows(0, stride)
        status = "No commands arrive: safe torques are in force." if plant.read()["safe"] else ""
        return json.dumps(
            {"run": number, "columns": {name: encoded(each) for name, each in rows.items()}, "status": status}
        )

    return answer
