"""The command ``race``: progress, table, JSON, figures, report, and the gains of each entry as a configuration.

The module does not bear the command's name: that is the function ``dualwinch.race``, which does the work.
"""

import json
import time
from pathlib import Path
from typing import Any

from dualwinch.codegen.files import atomic
from dualwinch.commands.doctor import versions
from dualwinch.commands.output import made_folder, make_folder, terminal
from dualwinch.commands.progress import StatusLine
from dualwinch.config.ensemble_file import loads_ensemble
from dualwinch.config.experiment_file import to_toml
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.settings import override
from dualwinch.tuning.benchmark.found import BenchmarkFindings
from dualwinch.tuning.benchmark.race import race
from dualwinch.tuning.benchmark.result import BenchmarkResult
from dualwinch.tuning.benchmark.scores import EntryResult
from dualwinch.tuning.benchmark.summary import to_record

GAINS = "gains"
"""Folder of the configurations."""


class Clock:
    """Says what is done and how long it will take, from the share that is done."""

    def __init__(self, status: StatusLine) -> None:
        self._status, self._began, self._entry = status, time.monotonic(), ""

    def __call__(self, share: float, words: str) -> None:
        """On a terminal at once; in a log where it is the next entry's turn."""
        entry = words.partition(":")[0]
        if self._status.console.is_terminal or entry != self._entry:
            self._entry = entry
            self._status.phase(f"{words}{self._left(share)}")

    def _left(self, share: float) -> str:
        """The time left, once there is something to tell it from."""
        if share < 0.01:
            return ""
        left = (time.monotonic() - self._began) * (1 / share - 1)
        return f" · {left / 60:.0f} min left" if left >= 90 else f" · {left:.0f} s left"


def run_race(out: Path, **words: Any) -> None:
    """Run, print, write.

    Args:
        out: folder of the race.
        words: of `dualwinch.race`.

    Raises:
        ConfigurationError: anything wrong with a kind, a key, a value, a constraint or the folder.
        KeyboardInterrupt: interrupted; what is finished is written.
    """
    with made_folder(out), StatusLine("race") as status:
        status.phase("reading the problem")
        found = race(out=out, progress=Clock(status), **words)
        status.phase("writing the report")
        written = write_race(out, found)
    terminal(soft_wrap=True).print(repr(found), highlight=False)
    status.say(f"wrote {', '.join(written)} in {out}")
    if found.left:
        raise KeyboardInterrupt


def write_race(out: Path, found: BenchmarkResult) -> list[str]:
    """Write ``race.json``, ``race.svg``, ``fronts.svg``, ``report.html``, and the gains of each entry.

    Returns:
        Names of the files that were written.
    """
    from dualwinch.reports.race import write_race_report
    from dualwinch.simulation.plots import save

    facts = to_record(found) | {f"version_{name}": version for name, version in versions().items()}
    with atomic(out / "race.json") as unfinished:
        unfinished.write_text(json.dumps(facts, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    save(found.plot(), out / "race.svg")
    save(found.plot_fronts(), out / "fronts.svg")
    write_race_report(out / "report.html", found, versions())
    make_folder(out / GAINS)
    for scored in found.entries:
        text = configuration(found, scored)
        if text:
            with atomic(out / GAINS / f"{scored.entry.stem}.toml") as unfinished:
                unfinished.write_text(text, encoding="utf-8")
    return ["race.json", "race.svg", "fronts.svg", "report.html", f"{GAINS}/"]


def configuration(found: BenchmarkFindings, scored: EntryResult) -> str:
    """The best gains of an entry as TOML; empty where its parts are not known here, as those of an earlier call."""
    nominal = loads_ensemble(found.terms.configuration, name="the race's ensemble").experiment
    try:
        best = override(nominal, {**scored.entry.values, **scored.gains})
    except ConfigurationError:
        return ""
    terms = found.terms
    words = f"{scored.entry.key}: the best of {terms.rollouts} rollouts in '{terms.ensemble}', seed {terms.seed}"
    return f"# {words}, by `dualwinch race`.\n\n{to_toml(best)}"
