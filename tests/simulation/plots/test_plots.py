"""Figures: what is drawn, not how many pixels it takes."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dualwinch import plots
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.ensembles.result import EnsembleResult
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.paper import CONTROLLERS, FIGURES, case, percent, steady_change
from dualwinch.simulation.plots.style import prefixed_unit
from dualwinch.simulation.plots.traces import peaks, thin
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from tests.tiers import all_but

Results = dict[str, Result]
PaperRun = Callable[[int, str], Result]

DRAWN = {
    "trajectory": plots.trajectory,
    "error": plots.error,
    "commands": plots.commands,
    "tensions": plots.tensions,
}


@pytest.fixture(scope="module")
def case_1(paper_run: PaperRun) -> Results:
    return {kind: paper_run(1, kind) for kind in CONTROLLERS}


@pytest.fixture(scope="module")
def case_4(paper_run: PaperRun) -> Results:
    return {kind: paper_run(4, kind) for kind in CONTROLLERS}


def texts(figure: Figure) -> str:
    words = [text.get_text() for text in figure.texts]
    for axes in figure.axes:
        words += [text.get_text() for text in axes.texts]
        words += [axes.get_title(loc) for loc in ("left", "center", "right")]  # pyright: ignore[reportArgumentType]
    return "\n".join(words)


def line(axes: Axes, kind: str) -> np.ndarray:
    return next(np.asarray(line.get_ydata()) for line in axes.lines if line.get_label() == CONTROLLERS[kind])


def legend_of(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


@given(
    rows=st.integers(1, 3000),
    columns=st.integers(1, 50),
    seed=st.integers(0, 99),
)
def test_thinning_keeps_order_ends_and_peaks(rows: int, columns: int, seed: int) -> None:
    t = np.arange(rows, dtype=float)
    values = np.random.default_rng(seed).normal(size=rows)
    kept_t, kept = thin(t, values, columns)
    assert (np.diff(kept_t) > 0).all()
    assert (kept_t[0], kept_t[-1]) == (t[0], t[-1])
    assert (kept.min(), kept.max()) == (values.min(), values.max())
    assert len(kept) <= max(4 * columns, 2 * columns + 2)


def test_thinning_keeps_gaps_and_drops_what_no_axis_can_show() -> None:
    t = np.arange(1000.0)
    values = np.sin(t)
    values[:500] = np.nan
    values[900] = 1e300
    values[901] = np.inf
    _, kept = thin(t, values, 10)
    assert np.isnan(kept).any()
    assert np.nanmax(np.abs(kept)) <= 1


def test_peaks_are_the_largest_of_each_interval() -> None:
    t = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5])
    middles, largest = peaks(t, np.array([1.0, -3.0, 0.0, 0.0, np.nan, 2.0, np.nan, np.nan]), 1.0)
    assert middles == pytest.approx([0.5, 1.5, 2.5, 3.5])
    assert largest == pytest.approx([3.0, np.nan, 2.0, np.nan], nan_ok=True)


@pytest.mark.parametrize(
    ("largest", "size", "name"),
    [
        (2.0, 1.0, "m"),
        (0.18, 1e-3, "mm"),
        (3e-6, 1e-6, "µm"),
        (0.0, 1e-6, "µm"),
        (np.nan, 1e-6, "µm"),
        (4e3, 1e3, "km"),
    ],
)
def test_a_quantity_gets_the_prefix_that_its_largest_value_needs(largest: float, size: float, name: str) -> None:
    assert prefixed_unit("m", largest, largest / 9, np.nan) == (size, name)


@pytest.mark.parametrize("content", DRAWN)
def test_headings_and_units(case_1: Results, content: str) -> None:
    figure = DRAWN[content](case_1)
    number = next(entry.number for entry in FIGURES if (entry.case, entry.content) == (1, content))
    assert f"Figure {number} · Case 1: " in texts(figure)
    assert "Uniform speed, no disturbance" in texts(figure)
    for axes in figure.axes:
        for axis_label in (axes.get_xlabel(), axes.get_ylabel()):
            assert not axis_label or axis_label.endswith(")"), "an axis without its unit"
    assert figure.get_size_inches()[0] == pytest.approx(7)


def test_another_scenario_has_no_figure_number(case_4: Results) -> None:
    result = case_4["nftsm"]
    other = replace(result.experiment.disturbance, strouhal=0.3, current_sigma=0.05)
    changed = replace(result, experiment=replace(result.experiment, disturbance=other))
    words = texts(plots.error({"nftsm": changed}))
    assert "Figure" not in words
    assert "Tracking error" in words
    assert "Profile, vortex shedding, current" in words


def test_trajectory_shows_the_lag_that_stays(case_4: Results) -> None:
    figure = plots.trajectory(case_4)
    position, speed = figure.axes
    (inset,) = position.child_axes
    assert isinstance(inset, Axes)
    assert inset.get_xlim() == pytest.approx((28.6, 29))
    low, high = inset.get_ylim()
    assert high - low == pytest.approx(0.4 * 1.8 + 0.17, abs=0.02)
    assert line(speed, "pid-cascade").max() == pytest.approx(1.8, abs=0.1)
    assert "reference" in legend_of(figure)


def test_error_panels_show_every_size(case_4: Results) -> None:
    whole, decades, steady = plots.error(case_4).axes
    assert whole.get_ylabel().endswith("(mm)")
    assert line(whole, "pid-cascade").min() == pytest.approx(-176.4, abs=0.1)
    assert decades.get_yscale() == "log"
    assert np.nanmax(line(decades, "fando-nftsm")) == pytest.approx(6.398e-3, rel=1e-3)
    assert np.abs(line(steady, "nftsm")).max() == pytest.approx(28.35, abs=0.01)
    assert steady.get_xlim() == (18, 29)
    assert CONTROLLERS["pid-cascade"] not in [line.get_label() for line in steady.lines]
    assert steady.texts[0].get_text() == "PID cascade: −176 to −152 mm, off this panel"


def test_commands_and_tensions_show_the_limits(case_4: Results) -> None:
    for figure in (plots.commands(case_4), plots.tensions(case_4)):
        levels = {
            float(np.asarray(line.get_ydata())[0])
            for line in figure.axes[0].lines
            if line.get_label() not in CONTROLLERS.values()
        }
        assert levels == {0.2, 6.0}
        assert "limits 0.2 and 6 kN" in legend_of(figure)


def test_tensions_show_the_overshoot_and_the_slack(case_1: Results) -> None:
    figure = plots.tensions(case_1)
    whole, zoom, _whole_2, zoom_2 = figure.axes
    assert line(whole, "fando-nftsm").max() == pytest.approx(7.98, abs=0.01)
    assert line(zoom, "fando-nftsm").max() == pytest.approx(7.98, abs=0.01)
    assert line(zoom_2, "fando-nftsm").min() == 0
    assert zoom_2.get_xlim() == (0, 60)
    assert "peak 7.98 kN at 5 ms (FANDO-NFTSM, NFTSM)" in texts(figure)
    assert "slack: FANDO-NFTSM 7 ms, NFTSM 7 ms" in texts(figure)


def test_bars_put_the_paper_beside_what_was_measured(case_4: Results) -> None:
    figure = plots.steady_state_bars(case_4)
    words = texts(figure)
    for expected in ("Figure 21 · Case 4", "−74.4 %", "−77.4 %", "−93.8 %", "−76 %", "−67 %", "−93.5 %", "6.40"):
        assert expected in words
    with pytest.raises(ConfigurationError, match="both are needed"):
        plots.steady_state_bars({"nftsm": case_4["nftsm"]})


def test_reductions(case_4: Results) -> None:
    merits = {kind: result.metrics for kind, result in case_4.items()}
    expected = {"mae": -0.744, "max_abs_error": -0.774, "mse": -0.938}
    assert steady_change(merits) == pytest.approx(expected, abs=5e-4)
    assert steady_change({"nftsm": merits["nftsm"]}) is None
    assert percent(-0.93756) == "−93.8 %"
    assert percent(-0.67, "+g") == "−67 %"


def test_overview_has_a_panel_for_what_a_controller_has(case_1: Results, case_4: Results) -> None:
    with_observer = plots.overview(case_4["fando-nftsm"])
    assert "disturbance acceleration" in texts(with_observer)
    assert len(with_observer.axes) == 5
    without = plots.overview(case_1["pid-cascade"])
    assert len(without.axes) == 4
    assert "force · beyond ±5.8 kN in 49.3 % of the run" in texts(without)
    assert "rope tensions · 0.124 to 6.34 kN" in texts(without)


@pytest.mark.slow
def test_a_subset_and_a_run_that_diverged(case_4: Results, tmp_path: Path) -> None:
    result = case_4["fando-nftsm"]
    rows = 1500
    columns = {name: values[:rows].copy() for name, values in result.columns.items()}
    for name in ("x", "v", "e", "F1", "u", "d_hat"):
        columns[name][-3:] = (1e250, -np.inf, np.nan)
    nothing = dict.fromkeys(("steady_mae", "steady_max_abs_error", "steady_mse"), np.nan)
    metrics = replace(result.metrics, max_abs_error=np.inf, **nothing)
    bad = replace(result, columns=columns, metrics=metrics, outcome="diverged", end_time=1.5)
    for draw in DRAWN.values():
        for results in ({"fando-nftsm": bad}, {"fando-nftsm": bad, "nftsm": case_4["nftsm"]}):
            figure = draw(results)
            assert "FANDO-NFTSM (diverged at 1.5 s)" in legend_of(figure)
            plots.save(figure, tmp_path / "figure.png")
    figure = plots.overview(bad)
    assert "FANDO-NFTSM (diverged at 1.5 s)" in texts(figure)
    plots.save(figure, f"{tmp_path}/figure.png")
    plots.save(plots.steady_state_bars({"fando-nftsm": bad, "nftsm": case_4["nftsm"]}), tmp_path / "figure.png")


@pytest.mark.parametrize("duration", all_but([1e-3], [1e-3, 3e-3, 20.0, 30.0]))
def test_runs_of_any_length(duration: float, tmp_path: Path) -> None:
    experiment = case(4, "nftsm")
    result = simulate(replace(experiment, simulation=replace(experiment.simulation, duration=duration)))
    for draw in DRAWN.values():
        plots.save(draw({"nftsm": result}), tmp_path / "figure.png")
    plots.save(plots.overview(result), tmp_path / "figure.png")


def test_nothing_to_draw_is_an_error(case_4: Results) -> None:
    result = case_4["nftsm"]
    empty = replace(result, columns={name: values[:0] for name, values in result.columns.items()})
    with pytest.raises(ConfigurationError, match="keeps no rows"):
        plots.error({"nftsm": empty})
    with pytest.raises(ConfigurationError, match="keeps no rows"):
        plots.overview(empty)
    with pytest.raises(ConfigurationError, match="at least one result"):
        plots.trajectory({})


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_files_are_the_same_every_time(case_4: Results, tmp_path: Path, suffix: str) -> None:
    contents = []
    for name in ("one", "two"):
        path = tmp_path / f"{name}{suffix}"
        plots.save(plots.steady_state_bars(case_4), path)
        contents.append(path.read_bytes())
    assert contents[0] == contents[1]
    assert contents[0] == plots.encode(plots.steady_state_bars(case_4), suffix.upper())
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"one{suffix}", f"two{suffix}"]


def test_a_file_that_cannot_be_written_leaves_nothing(case_4: Results, tmp_path: Path) -> None:
    figure = plots.steady_state_bars(case_4)
    with pytest.raises(ConfigurationError, match=r"unknown suffix '\.bmp'; must be one of \.png, \.svg, \.pdf"):
        plots.save(figure, tmp_path / "figure.bmp")
    taken = tmp_path / "figure.png"
    taken.mkdir()
    with pytest.raises(OSError, match=r"figure\.png"):
        plots.save(figure, taken)
    assert list(tmp_path.iterdir()) == [taken]


def test_global_settings_are_left_alone(case_4: Results, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)  # importing it now fails
    before = mpl.rcParams.copy()
    first = plots.encode(plots.error(case_4), ".svg")
    assert mpl.rcParams.copy() == before
    with mpl.rc_context({"font.size": 20, "axes.grid": False, "svg.hashsalt": "other"}):
        assert plots.encode(plots.error(case_4), ".svg") == first


@pytest.fixture(scope="module")
def at_sea() -> EnsembleResult:
    return run_ensemble(load_ensemble("sea"), 12, 7)


def test_a_fan_chart_shows_median_bands_and_extremes(at_sea: EnsembleResult) -> None:
    figure = plots.fan_chart(at_sea)
    error, *ropes = figure.axes
    traces = at_sea.traces
    assert traces is not None
    drawn = np.asarray(error.lines[0].get_ydata())
    assert np.allclose(drawn, 1e3 * np.median(traces.sampled["e"], axis=0))
    for axes, column, unit in zip((error, *ropes), ("e", "F1", "F2"), (1e-3, 1e3, 1e3), strict=True):
        outer, middle, inner = (
            np.ptp(np.asarray(band.get_paths()[0].vertices)[:, 1]) for band in list(axes.collections)[-3:]
        )
        assert (
            inner
            < middle
            <= outer
            == pytest.approx((traces.highest[column].max() - traces.lowest[column].min()) / unit)
        )
    limits = {6.0, 0.2}
    for axes in ropes:
        assert limits <= {float(np.asarray(line.get_ydata())[0]) for line in axes.lines}
    assert legend_of(figure)[:4] == ["median", "all scenarios", "90 %", "50 %"]
    words = texts(figure)
    assert "FANDO-NFTSM in the ensemble “sea”" in words
    assert "12 scenarios, seed 7; every one ran to its end" in words
    assert f"worst {1e3 * at_sea.statistic('worst.max_abs_error'):.3g} mm" in words


def test_a_fan_chart_says_what_it_leaves_out(at_sea: EnsembleResult) -> None:
    fewer = replace(at_sea, outcomes=np.array([*at_sea.outcomes[:9], "diverged", "diverged", "left_track"]))
    assert "9 scenarios, seed 7; not drawn: 2 diverged, 1 left track" in texts(plots.fan_chart(fewer))


def test_a_fan_chart_without_traces_is_refused(at_sea: EnsembleResult) -> None:
    with pytest.raises(ConfigurationError, match="needs traces"):
        plots.fan_chart(replace(at_sea, traces=None))


@pytest.mark.parametrize(("kind", "names"), [("fando-nftsm", 3), ("nftsm", 2)])
def test_an_estimate_that_the_filter_compensates_is_drawn_whole(kind: str, names: int) -> None:
    """Both the filter's share and the law's own estimate are subtracted from the force: their sum is the estimate."""
    experiment = override(
        case(4, kind),
        {"controller.estimator": "kalman", "controller.kalman.compensation": 0.8, "simulation.duration": 3.0},
    )
    result = simulate(experiment)
    panel = plots.overview(result).axes[-1]
    lines = {str(line.get_label()): np.asarray(line.get_ydata()) for line in panel.lines}
    names_drawn, drawn, law = list(lines), list(lines.values()), result.columns.get("d_hat", 0.0)
    assert len(lines) == names
    np.testing.assert_allclose(drawn[0], 1e3 * (0.8 * result["d_est"] + law))
    if kind == "fando-nftsm":
        assert names_drawn[0].startswith("whole estimate: filter's share and law's ")
        np.testing.assert_allclose(drawn[1], 1e3 * result["d_hat"])


def test_without_compensation_the_estimate_is_the_laws_own() -> None:
    result = simulate(override(case(4), {"controller.estimator": "kalman", "simulation.duration": 1.0}))
    estimate, _ = plots.overview(result).axes[-1].lines
    assert estimate.get_label() == "estimate"
    np.testing.assert_allclose(np.asarray(estimate.get_ydata()), 1e3 * result["d_hat"])
