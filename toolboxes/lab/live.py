"""The run of a served plant in the lab's page, which requests new rows while the run proceeds."""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from threading import Thread
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import Experiment
from dualwinch.toolboxes.lab.assemble import MOST_NUMBERS, differences, encoded
from dualwinch.toolboxes.lab.cli.lab import ADDRESS, HOST, page_of, server_of


class LivePlant(Protocol):
    """A plant that runs in real time, such as that of ``dualwinch serve``."""

    @property
    def experiment(self) -> Experiment:
        """Its experiment."""
        ...

    def rows(self, start: int, stride: int, /) -> tuple[int, dict[str, NDArray[np.float64]]]:
        """Number of the present run, and every `stride`-th of its rows from `start` on: name → column."""
        ...

    def read(self) -> dict[str, float]:
        """Present values by name; ``safe`` is 1 while safe torques are in force."""
        ...


@contextmanager
def live_page(plant: LivePlant) -> Iterator[str]:
    """Serve the page with a plant's runs while they proceed; yields its address."""
    with server_of(page_of(live_run(plant.experiment)), 0, live_rows(plant)) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://{HOST}:{server.server_port}/"
        finally:
            server.shutdown()


def live_run(experiment: Experiment) -> dict[str, Any]:
    """A live run with the settings of an experiment, in place of `assemble.own_run`."""
    return {"label": "the served plant", "live": ADDRESS, "settings": differences(experiment)}


def live_rows(plant: LivePlant) -> Callable[[Mapping[str, int]], str]:
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
