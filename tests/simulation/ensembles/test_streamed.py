"""Statistics without the scenarios: those of the whole result, whatever portions they were run in."""

import json
from pathlib import Path

import numpy as np
import pytest

from dualwinch.cli import main
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.ensembles.streamed import ValueStream, ensemble_statistics
from dualwinch.simulation.metrics.metrics import metric_quantities
from tests.lasting import lasting, peak_memory
from tests.simulation.batch.test_workers import Remote

VALUES = np.concatenate([np.random.default_rng(1).lognormal(0, 3, 3000), [-2.5, 0.0, 0.0, -1e-9, 1e200, -1e200, 7.0]])


def test_a_stream_has_the_exact_mean_and_quantiles_within_its_accuracy() -> None:
    stream = ValueStream(1e-3)
    stream.add(np.append(VALUES[:-3], [np.nan, np.inf]))
    stream.add(VALUES[-3:])
    assert stream.count == len(VALUES)
    assert stream.mean == pytest.approx(np.mean([*VALUES[:-3], 7.0]) * (len(VALUES) - 2) / len(VALUES))
    assert (stream.lowest, stream.highest) == (-1e200, 1e200)
    for share in (0.0, 1e-3, 0.05, 0.5, 0.95, 1.0):
        assert stream.quantile(share) == pytest.approx(np.quantile(VALUES, share), rel=1.01e-3)


def test_a_stream_is_the_same_in_any_order_and_portions() -> None:
    whole = ValueStream(1e-2)
    whole.add(VALUES)
    parts = [ValueStream(1e-2) for _ in range(3)]
    for part, values in zip(parts, np.array_split(np.random.default_rng(2).permutation(VALUES), 3), strict=True):
        part.add(values)
    for part in parts[1:]:
        parts[0].merge(part)
    assert vars(parts[0]) == vars(whole)
    assert np.isnan(ValueStream(1e-2).statistic("mean", small_is_bad=False))


def test_statistics_are_those_of_the_result_by_threads_and_by_an_executor() -> None:
    result = run_ensemble(lasting(0.2), 150, 7, traces=False)
    here, there = (ensemble_statistics(lasting(0.2), 150, 7, workers=workers) for workers in (1, Remote()))
    assert len(here) == 150
    assert here.outcome_counts == result.outcome_counts
    for name in metric_quantities():
        assert vars(here.metrics[name]) == vars(there.metrics[name])
        for kind in ("mean", "geomean", "median", "p95", "worst"):
            ours, theirs = here.statistic(f"{kind}.{name}"), result.statistic(f"{kind}.{name}")
            assert ours == pytest.approx(theirs, rel=1e-12 if kind in {"mean", "worst"} else 1.1e-3, nan_ok=True)
    with pytest.raises(ConfigurationError, match=r"accuracy = 2: must be > 0 and < 1"):
        ensemble_statistics(lasting(0.2), 1, 0, accuracy=2)


def test_the_command_prints_and_writes_statistics_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["simulate", "--ensemble", "sea", "--scenarios", "20", "--set", "simulation.duration=0.1"]
    main([*words, "--statistics-only", "--out", str(tmp_path / "sea.json")])
    main([*words, "--out", str(tmp_path / "rows.json")])
    ours, theirs = (json.loads((tmp_path / name).read_text()) for name in ("sea.json", "rows.json"))
    assert ours.keys() == theirs.keys()
    assert ours["statistics"]["mse"]["mean"] == pytest.approx(theirs["statistics"]["mse"]["mean"])
    assert "'sea', seed 0: 20 completed" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main([*words, "--statistics-only", "--out", str(tmp_path / "sea.csv")])
    with pytest.raises(SystemExit):
        main([*words, "--statistics-only", "--plot", str(tmp_path / "sea.png")])


@pytest.mark.slow
def test_memory_does_not_grow_with_the_number_of_scenarios() -> None:
    ensemble_statistics(lasting(0.01), 4, 0)  # imports and caches
    few, many = (
        peak_memory(lambda count=count: ensemble_statistics(lasting(0.01), count, 0, accuracy=0.2, workers=1))
        for count in (320, 960)
    )
    assert many - few < 640 * 500
