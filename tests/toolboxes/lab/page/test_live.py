"""A plant that is served, as the page follows it."""

from threading import Thread
from typing import Any

import pytest

from dualwinch.toolboxes.lab.assemble import assemble
from dualwinch.toolboxes.lab.cli.lab import server_of
from dualwinch.toolboxes.lab.live import live_rows, live_run
from tests.toolboxes.lab.page.conftest import Lab
from tests.toolboxes.server.clients import TORQUES, finished, serving, short

pytestmark = pytest.mark.external


def test_the_page_follows_a_run_that_is_under_way(browser: Any, made: Any) -> None:
    with serving(short(2.0)) as (plant, client, run):
        page = assemble(made.catalogue, made.modules, live_run(plant.experiment))
        with server_of(page, 0, live_rows(plant)) as server:
            Thread(target=server.serve_forever, daemon=True).start()
            client.begin()
            client.run(1500)
            lab = Lab(browser.new_page())
            lab.page.goto(f"http://127.0.0.1:{server.server_port}/")
            lab.page.wait_for_function("document.querySelector('#pin').title === 'A: the served plant'")
            read = client.sample()
            plant.write({"force": 1.0})
            client.say(TORQUES, read.sequence)
            client.run(2000)
            assert finished(run).outcome == "completed"
            lab.page.wait_for_function("parseFloat(document.querySelector('#clock').textContent) > 1.98")
            server.shutdown()
        assert not lab.complaints
        lab.page.wait_for_function("document.querySelector('#status').textContent === 'The served plant has ended.'")
        lab.page.close()
