"""A plant that is served, as the lab's page follows it: an address that gives new rows of its run."""

import json
from collections.abc import Callable, Mapping
from typing import Any

from dualwinch.lab.assemble import MOST_NUMBERS, differences, encoded
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.server.plant import ServedPlant

ADDRESS = "live"
"""Where the page asks, below its own address."""


def live_run(experiment: Experiment) -> dict[str, Any]:
    """In place of a run of one's own (`assemble.own_run`), one that the page follows; with an experiment's settings."""
    return {"label": "the served plant", "live": ADDRESS, "settings": differences(experiment)}


def live_rows(plant: ServedPlant) -> Callable[[Mapping[str, int]], str]:
    """What answers the page, as JSON.

    The page says which ``run`` it has, and how many ``rows`` of it; it is given the number of the present run, its
    further columns, and a status in words where safe torques are in force. Of a long run it gets every so many samples.
    """
    samples, columns = plant.experiment.samples, len(plant.rows(0, 1)[1])
    stride = max(1, -(-samples * columns // MOST_NUMBERS))

    def answer(asked: Mapping[str, int]) -> str:
        number, rows = plant.rows(max(0, asked.get("rows", 0)) * stride, stride)
        if number != asked.get("run"):
            number, rows = plant.rows(0, stride)
        status = "No command comes: safe torques are in force." if plant.read()["safe"] else ""
        return json.dumps(
            {"run": number, "columns": {name: encoded(each) for name, each in rows.items()}, "status": status}
        )

    return answer
