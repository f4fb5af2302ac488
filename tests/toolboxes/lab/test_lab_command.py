"""The lab's page: written, served, and with a run of one's own."""

import base64
import http.client
import json
import re
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.cli import main
from dualwinch.toolboxes.lab.assemble import own_run
from dualwinch.toolboxes.lab.cli import lab
from dualwinch.toolboxes.lab.content import content
from dualwinch.toolboxes.lab.wasm.structures import structures
from tests.conftest import Refused
from tests.toolboxes.lab.in_node import zig_is_there

needs_zig = pytest.mark.skipif(not zig_is_there(), reason="needs zig")


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """A lab of the paper's structure alone."""
    offered = structures()[:1]
    monkeypatch.setattr("dualwinch.toolboxes.lab.content.content", partial(content, offered=offered))


def own_run_in(page: str) -> dict[str, Any]:
    found = re.search(r'<script[^>]*id="own-run"[^>]*>(.*?)</script>', page, re.DOTALL)
    assert found
    return json.loads(found[1])


@pytest.mark.external
@needs_zig
@pytest.mark.usefixtures("small")
def test_the_page_is_one_file(tmp_path: Path) -> None:
    file = tmp_path / "lab.html"
    main(["lab", "--out", str(file)])
    page = file.read_text(encoding="utf-8")
    assert page.lower().startswith("<!doctype html>")
    assert own_run_in(page) is None
    assert not re.search(r'(src|href)="https?:', page)  # nothing is loaded from elsewhere
    assert len(page.encode()) < 1e6


@pytest.mark.external
@needs_zig
@pytest.mark.usefixtures("small")
def test_a_run_of_ones_own_is_in_the_page(tmp_path: Path) -> None:
    result = dw.simulate(dw.override(dw.case(1), {"controller.observer.l0": 20.0}))
    dw.save(result, tmp_path / "mine.parquet")
    main(["show", str(tmp_path / "mine.parquet")])
    own = own_run_in((tmp_path / "mine.html").read_text(encoding="utf-8"))
    assert own["label"] == "mine.parquet"
    assert own["settings"] == {"reference.kind": "uniform", "controller.observer.l0": 20.0}
    assert own["metrics"] == dict(result.metrics)
    np.testing.assert_array_equal(np.frombuffer(base64.b64decode(own["columns"]["F2"]), "<f8"), result["F2"][::4])


def test_a_page_takes_two_megabytes_of_a_run_at_most() -> None:
    run = own_run("run", dw.simulate(dw.override(dw.case(4), {"simulation.duration": 50.0})))
    assert len(json.dumps(run)) < 2.2e6
    assert len({len(column) for column in run["columns"].values()}) == 1


def test_a_run_without_rows_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    dw.save(dw.simulate(dw.case(1), stride=0), tmp_path / "bare.npz")
    with pytest.raises(SystemExit):
        main(["show", str(tmp_path / "bare.npz")])
    assert "bare.npz: holds no rows" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["lab", "--port", "70000"], "--port = 70000: must be 0 to 65535"),
        (["lab", "--out", "lab.pdf"], "lab.pdf: unknown suffix '.pdf'; must be one of .html, .htm"),
        (["lab", "--out", "nowhere/lab.html"], "nowhere: no such folder"),
        (["show", "nothing.parquet"], "cannot read nothing.parquet"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(words: list[str], complaint: str, refused: Refused) -> None:
    assert complaint in refused(*words)


def test_a_missing_zig_is_said_in_a_line(monkeypatch: pytest.MonkeyPatch, refused: Refused) -> None:
    monkeypatch.setattr("dualwinch.codegen.compiler._zig", lambda: None)
    monkeypatch.setenv("PATH", "")  # what has been found before is known by the path
    assert "pip install 'dualwinch[zig]', or uv run --extra zig" in refused("lab --no-browser", code=1)


@pytest.fixture
def port() -> Iterator[int]:
    with lab.server_of("<p>here</p>", 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server.server_port
        server.shutdown()
        thread.join()


def asked(port: int, path: str) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection(lab.HOST, port, timeout=10)
    connection.request("GET", path)
    answer = connection.getresponse()
    return answer.status, answer.read()


def test_it_is_served_on_this_machine(port: int) -> None:
    assert asked(port, "/?case=4") == (200, b"<p>here</p>")
    assert asked(port, "/etc/passwd") == (404, b"")


def test_a_port_that_is_taken_is_an_error(port: int) -> None:
    with pytest.raises(dw.ConfigurationError, match=f"--port = {port}: .*0 takes any that is free"):
        lab.server_of("", port)
