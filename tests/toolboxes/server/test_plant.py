import json
import socket
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.reference import Reference
from dualwinch.plots import overview
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.results.file_formats import load_result, save
from dualwinch.toolboxes.server.plant import ServedPlant, ServerSettings, approach
from dualwinch.toolboxes.stepper.stepper import Stepper
from tests.toolboxes.server.clients import (
    COMMAND,
    ENDED,
    HELLO,
    HOLDING,
    MAY_WRITE,
    RUNNING,
    SAFE,
    STARTS,
    TORQUES,
    Client,
    finished,
    serving,
    short,
)

WITH_NOISE = {"sensors.position_noise": 1e-3, "sensors.encoder_counts": 4096, "disturbance.current_sigma": 0.05}


def machine(name: str) -> Experiment:
    """Case 4 with noise, or the nominal machine of an ensemble, for a short time."""
    if name == "case 4":
        return short(0.2, **WITH_NOISE)
    return dw.override(dw.load_ensemble(name).experiment, {"simulation.duration": 0.2})


@pytest.mark.parametrize("name", ["case 4", *(pytest.param(name, marks=pytest.mark.slow) for name in ("rig", "site"))])
def test_in_lockstep_a_run_is_that_of_a_stepper_bit_for_bit(name: str) -> None:
    experiment = machine(name)
    with serving(experiment) as (plant, client, run):
        client.begin()
        assert client.run(300).flags & ENDED
        result = finished(run)
        assert plant.timing["delay_s"] == 0
    stepper = Stepper(experiment, 1, exact=True)
    for _ in range(200):
        stepper.step([HOLDING])
    expected = stepper.result(0)
    assert result.outcome == "completed"
    for column in ("t", "x", "v", "theta_1", "F1", "F2", "tau_1", "tau_2", "x_ref"):
        assert np.array_equal(result[column], expected[column]), column
    assert dict(result.metrics) == pytest.approx(dict(expected.metrics), rel=1e-15, nan_ok=True)


def test_a_datagram_holds_the_readings_of_its_sample() -> None:
    with serving(short(0.05, **WITH_NOISE)) as (plant, client, run):
        client.begin()
        seen = [client.run(1) for _ in range(50)]
        result = finished(run)
    columns = ["t", *(f"{name}_read" for name in list(plant.outputs)[1:9]), "x_ref", "v_ref", "a_ref"]
    for read in seen:
        expected = [result[name][read.sequence] for name in columns]
        assert read.signals[:12] == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_by_the_clock_a_command_acts_a_sample_after_its_readings() -> None:
    with serving(short(0.05), ServerSettings(rate=0.5, may_write=True)) as (plant, client, run):
        client.begin()
        client.run(100)
        assert finished(run).outcome == "completed"
        timing = plant.timing
    assert timing["ticks"] == sum(timing["lateness"].values()) == 50
    assert timing["commanded"] + sum(finished(run)["tau_1"] != HOLDING[0]) >= 50


def test_torques_are_safe_when_the_controller_falls_silent_and_until_it_is_back() -> None:
    settings = ServerSettings(lockstep=True, may_write=True, watchdog=0.01, safe=(20.0, 21.0))
    with serving(short(0.1), settings) as (plant, client, run):
        client.begin()
        client.run(20)
        flags = 0
        for _ in range(30):  # it goes on, but says nothing
            read = client.sample()
            flags = read.flags
            client.say(0, read.sequence)
        assert flags & SAFE
        assert plant.counts["silences"] == 1
        client.run(100)
        result = finished(run)
    safe = (result["tau_1"] == 20.0) & (result["tau_2"] == 21.0)
    assert np.flatnonzero(safe).tolist() == list(range(30, 50))  # 10 samples after the command of sample 19
    assert np.all(result["tau_1"][~safe] == HOLDING[0])


def test_the_brake_stops_the_vehicle_and_the_reference_stays_where_that_was() -> None:
    distances = []
    for brake in (False, True):
        settings = ServerSettings(lockstep=True, may_write=True, watchdog=0.01, brake=brake)
        with serving(short(6.0), settings) as (plant, client, run):
            client.begin()
            client.run(2000, (60.0, 22.0))
            for _ in range(3999):
                read = client.sample()
                client.say(0, read.sequence)
            assert plant.read()["held"] == 1
            held = plant.read()["x_ref"]
            client.run(10)
            result = finished(run)
        assert result["v"][2000] > 0.2
        assert held == pytest.approx(result["x"][-1], abs=0.05)
        assert min(result["F1"][3000:].min(), result["F2"][3000:].min()) > 150
        distances.append(float(result["x"][-1] - result["x"][2010]))
    coasting, braked = distances
    assert abs(result["v"][-1]) < 0.02
    assert braked < 0.5 * coasting


def test_a_start_without_a_controller_is_no_silence() -> None:
    settings = ServerSettings(may_write=True, rate=20.0, watchdog=0.01)
    with serving(short(0.1), settings) as (plant, _, run):
        plant.write({"start": 1.0})
        finished(run)
        assert plant.timing["silences"] == 0


def odd_datagrams(sequence: int) -> list[bytes]:
    """What is no valid command at a sample."""
    good = COMMAND.pack(b"DWC1", TORQUES, sequence, 50.0, 50.0)
    return [
        b"",
        b"x",
        good[:-1],
        good + b"\0",
        bytes(65507),
        COMMAND.pack(b"DWC2", TORQUES, sequence, 50.0, 50.0),
        COMMAND.pack(b"DWC1", 64, sequence, 50.0, 50.0),
        COMMAND.pack(b"DWC1", TORQUES | HELLO, sequence, 50.0, 50.0),
        COMMAND.pack(b"DWC1", TORQUES, sequence + 1, 50.0, 50.0),
        COMMAND.pack(b"DWC1", TORQUES, 2**64 - 1, 50.0, 50.0),
        COMMAND.pack(b"DWC1", TORQUES, max(sequence - 1, 0), 50.0, 50.0) if sequence > 5 else b"?",
        *(COMMAND.pack(b"DWC1", TORQUES, sequence, odd, 22.0) for odd in (np.nan, np.inf, 1e9, -1e300)),
        np.random.default_rng(sequence).bytes(COMMAND.size),
    ]


@pytest.mark.parametrize("whose", ["of the client itself", "of others"])
def test_malformed_and_flooding_datagrams_change_nothing(whose: str) -> None:
    with serving(short(0.1)) as (plant, client, run):
        client.begin()
        sender = client.socket if whose == "of the client itself" else socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        for _ in range(100):
            read = client.sample()
            for content in odd_datagrams(read.sequence):
                try:
                    sender.sendto(content, ("127.0.0.1", plant.port))
                except ConnectionRefusedError:  # the system turns others away
                    assert whose == "of others"
            if whose == "of others":  # one that would take over, very fast
                for _ in range(50):
                    sender.sendto(
                        COMMAND.pack(b"DWC1", TORQUES | STARTS, read.sequence, 99.0, 99.0), ("127.0.0.1", plant.port)
                    )
            client.say(TORQUES, read.sequence, HOLDING)
        result = finished(run)
        if sender is not client.socket:
            sender.close()
    assert result.outcome == "completed"
    assert np.all(result["tau_1"] == HOLDING[0])
    assert np.all(result["tau_2"] == HOLDING[1])


def test_without_leave_nobody_starts_commands_or_disturbs() -> None:
    with serving(short(0.05), ServerSettings(lockstep=True)) as (plant, client, run):
        client.say(HELLO)
        for _ in range(5):
            assert not client.read().flags & (RUNNING | MAY_WRITE)
            client.say(TORQUES | STARTS, 0, HOLDING)
        with pytest.raises(ConfigurationError, match="writing is not allowed"):
            plant.write({"start": 1.0})
        assert not run.done()
        plant.close()
        assert run.result(120) is None
        assert plant.counts["not_allowed"] >= 4


def test_when_a_client_has_gone_another_is_admitted() -> None:
    settings = ServerSettings(lockstep=True, may_write=True, release=0.05)
    with serving(short(0.05), settings) as (plant, client, run):
        client.begin()
        client.run(20)
        client.socket.close()
        other = Client(plant.port)
        while other.is_refused():
            pass
        other.run(100, (23.0, 23.0))
        result = finished(run)
        other.socket.close()
    assert result["tau_1"].tolist() == [HOLDING[0]] * 20 + [23.0] * 30


def test_inputs_act_from_the_next_sample_on() -> None:
    with serving(short(0.3)) as (plant, client, run):
        client.begin()
        client.run(100)
        client.sample()
        plant.write({"force": 5000.0, "outage": 1.0, "target": 30.0})
        client.say(TORQUES, 100, HOLDING)
        client.run(99)
        client.sample()
        plant.write({"outage": 0.0, "slack_2": 1.0, "force": 0.0})
        client.say(TORQUES, 200, HOLDING)
        client.run(200)
        result, notes = finished(run), plant.notes
    x, read = result["x"], result["x_read"]
    silent = read != x
    assert not silent[:101].any()
    assert silent[102:200].all()
    assert not silent[202:].any()
    assert np.diff(result["v"][102:200]).min() > 0.9 * 1e-3 * 5000 / 2.5e4
    assert np.all(result["tau_2"][202:] == 0)
    assert result["F2"][-1] < result["F2"][200]
    assert [event["input"] for event in json.loads(notes["events"])] == [
        *("force", "outage", "target", "outage", "slack_2", "force"),
    ]


def test_a_run_that_is_stopped_is_kept_and_another_begins_from_rest() -> None:
    with serving(short(0.2), runs=2) as (plant, client, first, second):
        client.begin()
        client.run(50)
        client.sample()
        plant.write({"force": 1.0, "stop": 1.0})
        result = finished(first)
        assert (result.outcome, len(result["t"])) == ("running", 50)
        again = Client(plant.port)
        with again.socket:
            again.begin()
            assert plant.written["force"] == 0
            again.run(300)
            assert finished(second).outcome == "completed"


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"force": 1e9}, r"force = 1e\+09: must be a finite number >= -100000 and <= 100000 N"),
        ({"force": np.nan}, "force = nan"),
        ({"target": -1.0}, "target = -1: must be a finite number >= 0 and <= 50 m"),
        ({"tau_1_cmd": 1e6}, r"tau_1_cmd = 1e\+06: must be a finite number >= -266.667"),
        ({"forces": 1.0}, "forces: must be one of tau_1_cmd"),
    ],
)
def test_a_value_out_of_range_is_refused_and_nothing_is_set(values: dict[str, float], words: str) -> None:
    with serving(short(0.05)) as (plant, _, _):
        with pytest.raises(ConfigurationError, match=words):
            plant.write({"current": 1.0, **values})
        assert plant.written["current"] == 0


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"rate": 0.0}, r"rate = 0\.0: must be a finite number > 0 and <= 1000"),
        ({"watchdog": -1.0}, r"watchdog = -1\.0: must be a finite number > 0 and <= 10 s"),
        ({"release": np.nan}, "release = nan"),
        ({"largest": np.inf}, "largest = inf"),
        ({"priority": 100}, "priority = 100: must be a whole number >= 0 and <= 99"),
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        ServerSettings(**settings)


def test_safe_torques_must_be_within_what_is_accepted() -> None:
    with pytest.raises(ConfigurationError, match=r"safe = 500, 0: must be within ±266.667 and ±266.667 N m"):
        ServedPlant(short(0.05), ServerSettings(safe=(500.0, 0.0)))


def test_an_address_that_cannot_be_used_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"cannot listen at 192\.0\.2\.1, port 5"):
        ServedPlant(short(0.05), host="192.0.2.1", port=5)


@pytest.mark.parametrize(("v", "target"), [(0.0, 40.0), (1.8, 40.0), (1.8, 5.0), (-0.5, 12.0), (0.0, 10.0)])
def test_a_new_target_is_approached_without_a_step_in_position_or_speed(v: float, target: float) -> None:
    reference = Reference(kind="way-points", points=(1.0,), acceleration=0.2)
    t = np.arange(80_000, dtype=np.float64) * 1e-3
    x, speed, a = approach(t, 10.0, v, target, reference)
    assert (x[0], speed[0]) == (10.0, v)
    assert x[-1] == pytest.approx(target)
    assert speed[-1] == 0
    assert np.abs(a).max() <= 0.2 * (1 + 1e-9)
    assert np.abs(np.diff(speed)).max() <= 0.2e-3 * (1 + 1e-6)
    assert np.diff(x) == pytest.approx((speed[1:] + speed[:-1]) / 2 * 1e-3, abs=1e-6)


def test_what_happened_is_a_result_file_like_any_other(tmp_path: Path) -> None:
    with serving(short(0.1)) as (plant, client, run):
        client.begin()
        client.run(300)
        result = finished(run)
    for suffix in ("parquet", "csv"):
        save(result, tmp_path / f"run.{suffix}", plant.notes)
        assert load_result(tmp_path / f"run.{suffix}") == result
    assert overview(result).axes


def test_a_missing_position_is_no_number() -> None:
    with serving(short(0.05, **{"sensors.outage": "missing"})) as (plant, client, run):
        client.begin()
        client.run(10)
        client.sample()
        plant.write({"outage": 1.0})
        client.say(TORQUES, 10, HOLDING)
        read = client.run(2)
        client.run(100)
        assert np.isnan(read.signals[1])
        assert finished(run).outcome == "completed"


def test_the_layout_is_little_endian_without_gaps() -> None:
    with serving(short(0.05)) as (plant, client, _):
        client.say(HELLO)
        content = client.socket.recv(65536)
    assert len(content) == 16 + 8 * plant.signals
    assert content[:4] == b"DWM1"
    assert struct.unpack_from("<d", content, 16 + 8 * 3)[0] == pytest.approx(1000, abs=1)
