"""``dualwinch serve``: runs of a client, what is said of them, and what is left of them."""

import base64
import http.client
import json
import os
import re
import signal
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.analysis.remarks import loop_remarks
from dualwinch.cli import main
from dualwinch.toolboxes.lab.live import live_run
from dualwinch.toolboxes.server import cli as serve
from dualwinch.toolboxes.server.plant import ServedPlant, ServerSettings
from tests.conftest import Refused
from tests.dualwinch.test_printed_figures import left_out
from tests.toolboxes.server.clients import ENDED, HELLO, HOLDING, STARTS, TORQUES, Client, finished, serving, short

SHORT = ("--case", "4", "--set", "simulation.duration=0.1", "--allow-write")
LONGER = ("--case", "4", "--set", "simulation.duration=0.5", "--allow-write")


def free_port() -> int:
    """A port for datagrams that is free now."""
    plant = ServedPlant(short(0.1))
    plant.release()
    return plant.port


def connected(port: int) -> Client:
    """A client of a command, once that listens."""
    client = Client(port)
    client.socket.settimeout(0.05)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        try:
            client.say(HELLO)
            client.read()
        except (TimeoutError, ConnectionRefusedError):
            continue
        client.socket.settimeout(120.0)
        return client
    raise TimeoutError("the command does not serve")


def runs(port: int, count: int) -> None:
    """Whole runs of a client each."""
    for _ in range(count):
        client = connected(port)
        client.say(TORQUES | STARTS, 0, HOLDING)
        assert client.run(1000).flags & ENDED
        client.socket.close()


def served(client: Callable[[int], None], *words: str, run: Sequence[str] = SHORT) -> None:
    """The command, and a client of it at the same time."""
    port = free_port()
    with ThreadPoolExecutor(1) as pool:
        used = pool.submit(client, port)
        main(["serve", *run, "--udp", str(port), *words])
        used.result(120)


def test_each_run_is_printed_and_becomes_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, registers = tmp_path / "run.npz", tmp_path / "map.csv"
    served(
        lambda port: runs(port, 2), "--lockstep", "--runs", "2", "--out", str(file), "--map", str(registers), "--json"
    )
    said = capsys.readouterr()
    decoder = json.JSONDecoder()
    first, end = decoder.raw_decode(said.out)
    second, _ = decoder.raw_decode(said.out[end:].strip())
    assert first["outcome"] == second["outcome"] == "completed"
    assert first["metrics"] == second["metrics"]
    assert first["timing"]["delay_s"] == 0
    assert first["timing"]["commanded"] == 100
    result = dw.load_result(file)
    assert result.metrics["mse"] == first["metrics"]["mse"]
    assert np.all(result["tau_2"] == HOLDING[1])
    assert dw.load_result(tmp_path / "run-2.npz")["x"].tolist() == result["x"].tolist()
    served(lambda port: runs(port, 1), "--lockstep", "--runs", "1", "--out", str(file))
    assert dw.load_result(tmp_path / "run-3.npz")["x"].tolist() == result["x"].tolist(), "nothing is overwritten"
    assert "run-3.npz" in capsys.readouterr().err
    assert registers.read_text().startswith("name,access,unit,meaning,range,modbus")
    assert re.search(r"serving at 127\.0\.0\.1:\d+ \(UDP\); clients may write", said.err)


def test_it_says_how_time_was_kept_and_when_a_controller_fell_silent(capsys: pytest.CaptureFixture[str]) -> None:
    def silent(port: int) -> None:
        client = connected(port)
        client.say(TORQUES | STARTS, 0, HOLDING)
        client.socket.close()

    served(silent, "--runs", "1", "--safe", "20,21", run=LONGER)
    said = capsys.readouterr()
    assert "no command for 0.05 s; the safe torques 20 and 21 N m are in force" in said.err
    assert "of 500 samples more than a period late" in said.out
    assert "safe torques 1 times" in said.out or "commands: 0 accepted" in said.out


def test_every_figure_printed_is_in_the_json(capsys: pytest.CaptureFixture[str]) -> None:
    with serving(short(0.1), ServerSettings(may_write=True)) as (plant, client, run):
        client.begin()
        client.run(300)
        result = finished(run)
    serve.print_run(plant, result, json=False)
    printed = capsys.readouterr().out
    serve.print_run(plant, result, json=True)
    assert "more than a period late" in printed
    assert not left_out(printed, json.loads(capsys.readouterr().out))


def test_remarks_are_about_the_plant_and_not_about_the_experiments_own_controller(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The observer's gain makes its loop unstable on this machine; without torque the ropes go slack."""
    machine = {"plant.vehicle.mass": 9000.0, "controller.observer.l0": 3000.0}
    assert any("unstable at small amplitudes" in words for words in loop_remarks(dw.override(dw.case(4), machine)))

    def relaxed(port: int) -> None:
        client = connected(port)
        client.say(TORQUES | STARTS, 0, (0.0, 0.0))
        assert client.run(1000, (0.0, 0.0)).flags & ENDED
        client.socket.close()

    settings = [word for key, value in machine.items() for word in ("--set", f"{key}={value}")]
    for form in ([], ["--json"]):
        served(relaxed, "--lockstep", "--runs", "1", *settings, *form)
        printed = capsys.readouterr().out
        assert "a rope is slack in" in printed
        assert "unstable" not in printed
        assert "linearise" not in printed


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--rate", "0"], "rate = 0.0: must be a finite number > 0 and <= 1000"),
        (["--safe", "1"], "--safe 1: must be two torques in N m, such as 22,22"),
        (["--safe", "nan,1"], "safe = (nan, 1.0): must be a list of finite numbers"),
        (["--lockstep", "--rate", "2"], "--rate: needs --realtime; with --lockstep there is no clock"),
        (["--runs", "0"], "--runs = 0: must be a whole number >= 1"),
        (["--udp", "70000"], "UDP port = 70000: must be 0 to 65535"),
        (["--modbus", "0"], "Modbus port = 0: must be 1 to 65535"),
        (["--out", "run.txt"], "run.txt"),
        (["--out", "folder.csv"], "folder.csv: is a folder; must be the name of a file"),
        (["--map", "map.txt"], "map.txt: unknown suffix '.txt'; must be one of .csv, .md"),
        (["--host", "192.0.2.1"], "cannot listen at 192.0.2.1"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(
    words: list[str], expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Refused
) -> None:
    (tmp_path / "folder.csv").mkdir()
    monkeypatch.chdir(tmp_path)
    assert expected in refused("serve", *SHORT, *words)


def test_ctrl_c_ends_a_run_and_keeps_what_happened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    def starts(port: int) -> None:
        client = connected(port)
        client.say(TORQUES | STARTS, 0, HOLDING)
        client.run(20)
        monkeypatch.setattr(serve, "wait", interrupted)
        client.socket.close()

    served(starts, "--lockstep", "--out", str(tmp_path / "run.npz"))
    result = dw.load_result(tmp_path / "run.npz")
    assert result.outcome == "running"
    assert len(result["t"]) == 20


def test_a_terminated_run_keeps_what_happened(tmp_path: Path) -> None:
    def starts(port: int) -> None:
        client = connected(port)
        client.say(TORQUES | STARTS, 0, HOLDING)
        client.run(20)
        time.sleep(0.2)  # the command is watching by now
        os.kill(os.getpid(), signal.SIGTERM)
        client.socket.close()

    served(starts, "--lockstep", "--out", str(tmp_path / "run.npz"))
    assert 10 <= len(dw.load_result(tmp_path / "run.npz")["t"]) < 100
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_the_lab_follows_a_run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("dualwinch.toolboxes.lab.live.page_of", lambda own: f"<p>{own['live']}</p>")
    plant = ServedPlant(short(0.1), ServerSettings(lockstep=True, may_write=True))
    with serve.shown(plant, [], "127.0.0.1", lab=True), ThreadPoolExecutor(1) as pool:
        run = pool.submit(plant.serve)
        client = Client(plant.port)
        client.begin()
        client.run(50)
        client.sample()
        said = re.search(r", http://(\S+)/ \(lab\)", capsys.readouterr().err)
        assert said
        address = http.client.HTTPConnection(said[1])

        def asked(path: str) -> str:
            address.request("GET", path)
            return address.getresponse().read().decode()

        assert asked("/") == "<p>live</p>"
        first = json.loads(asked("/live?run=0&rows=0"))
        x = np.frombuffer(base64.b64decode(first["columns"]["x"]))
        assert (first["run"], len(x)) == (1, 50)
        client.say(TORQUES, 50, HOLDING)
        client.run(100)
        result = run.result(120)
        further = json.loads(asked("/live?run=1&rows=50"))
        x = np.append(x, np.frombuffer(base64.b64decode(further["columns"]["x"])))
        assert x.tolist() == result["x"].tolist() if result else False
        assert len(json.loads(asked("/live?run=7&rows=50"))["columns"]["t"]) > len(further["columns"]["t"])
        address.close()
        client.socket.close()
    plant.release()
    assert live_run(dw.case(4))["settings"]["disturbance.vortex"]
