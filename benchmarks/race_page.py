"""What a race says about the paper's claims: the tables of its page, from the race's JSON.

``python -m benchmarks.race_page race`` prints the tables of ``dualwinch race --out race``; ``--write FILE`` puts each
between its two marks, ``--figures FOLDER`` copies the figures to there.
"""

import json
import math
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.document import command, markdown, publish
from dualwinch.simulation.ensembles.comparison import Interval
from dualwinch.toolboxes.race.entries import CONSTANT_GAIN, LINEAR_SURFACE, NO_ANTI_SATURATION, NO_OBSERVER, PAPER_LAW
from dualwinch.toolboxes.race.scores import below_words, ratio_words, spaced

Record = Mapping[str, Any]

FIGURES = {"race.svg": "race.svg"}
"""Figure of a race → its name among those of the documents."""

ENDS = ("estimate", "low", "high")
"""Names of a ratio and of both ends of its interval."""

MILLIMETRES = 1e3


@dataclass(frozen=True)
class Claim:
    """What the paper says of a part, and who is compared to find out.

    Attributes:
        words: the claim.
        without: in words, what stands in the part's place.
        other: what that entry is, where it differs from the paper's law with the usual parts.
    """

    words: str
    without: str
    other: Mapping[str, str]


CLAIMS = (
    Claim("sliding mode tracks better than a PID cascade (4.3)", "`pid-cascade`", {"law": "pid-cascade"}),
    Claim("the disturbance observer takes 76 % off the error (4.3)", "`nftsm`", {"law": NO_OBSERVER}),
    Claim("its gain has to adapt, by fuzzy rules (3.1.3)", CONSTANT_GAIN, {"variant": CONSTANT_GAIN}),
    Claim("saturation has to be remembered (3.1.2)", NO_ANTI_SATURATION, {"variant": NO_ANTI_SATURATION}),
    Claim("the surface has to be a fast terminal one (3.1.1)", LINEAR_SURFACE, {"variant": LINEAR_SURFACE}),
    Claim("winches have to share tension (3.2)", "`master-slave`", {"coordination": "master-slave"}),
    Claim("winches have to share tension (3.2)", "`force-position`", {"coordination": "force-position"}),
)
"""What the paper says, with its sections."""


def paper_entry(race: Record) -> Record | None:
    """The paper's law as it is, with the parts that most entries have."""
    usual = _usual(race)
    wanted = {"law": PAPER_LAW, "variant": "", **usual}
    return next((entry for entry in race["entries"] if _is(entry, wanted)), None)


def claims_table(race: Record) -> str:
    """Claim, what stands in the part's place, how the error changes, and whether the rule says that they differ."""
    whole, rows = paper_entry(race), []
    for claim in CLAIMS:
        wanted = {"law": PAPER_LAW, "variant": "", **_usual(race), **claim.other}
        other = next((entry for entry in race["entries"] if _is(entry, wanted)), None)
        found = ["–", "not run"] if not (whole and other) else _compared(race, other, whole)
        rows.append([claim.words, claim.without, *found])
    return markdown(["the paper says", "instead, tuned alike", "error over the paper's law's", "by the rule"], rows)


def race_table(race: Record) -> str:
    """Everybody in the test set, the best first."""
    numbers = {entry["key"]: str(rank) for rank, entry in enumerate(race["entries"], 1)}
    rows = [
        [
            f"{numbers[entry['key']]}. {entry['name']}",
            _below(entry["over_paper"]),
            *_figures(entry),
            _constraints(entry, race),
            ", ".join(numbers[key] for key in entry["not_different"]) or "–",
        ]
        for entry in race["entries"]
    ]
    rows.append(["the paper's gains", "1 ×", *_figures(race["paper"]), _constraints(race["paper"], race), ""])
    headings = ["", "error below the paper's", "RMS error (mm)", "chatter (N)"]
    return markdown([*headings, "constraints", "does not differ from"], rows)


def facts(race: Record) -> str:
    """What the race was, in two sentences."""
    entries = race["entries"]
    trials = [entry["search"]["trials"] for entry in entries]
    searches = sum(len(entry["searches"]) for entry in entries)
    words = (
        f"{len(entries)} entries in `{race['ensemble']}`, {searches} searches of {race['rollouts']} rollouts by "
        f"`{race['method']}` ({min(trials)} to {max(trials)} trials), {race['test_scenarios']} test scenarios, "
        f"seed {race['seed']}."
    )
    if searches > len(entries):
        words += f" Searches of the same entry are up to a factor of {spaced(race['search_spread'])} apart."
    return f"*{words}*"


def least(race: Record) -> str:
    """What nobody gets below."""
    found = race["lower_bounds"]
    if not found["beyond_authority"]:
        return "The reference is feasible in all scenarios."
    without, given = (_rms(found[name]) for name in ("without_foresight", "with_foresight"))
    best = min(value for entry in race["entries"] if (value := entry["statistics"]["mean.mse"]) is not None)
    return (
        f"In {found['beyond_authority']} of the {race['test_scenarios']} scenarios the reference is infeasible: it "
        f"needs more force than the motors can deliver. Lower bound on the RMS error over all scenarios: {without} mm "
        f"for a non-anticipating optimal controller, {given} mm with full foresight; the best here "
        f"reaches {_rms(best)} mm."
    )


def _usual(race: Record) -> dict[str, str]:
    """Estimator and coordination that most entries have."""
    counted = {
        part: [entry[part] for entry in race["entries"]] for part in ("estimator", "coordination") if race["entries"]
    }
    return {part: max(kinds, key=kinds.count) for part, kinds in counted.items()}


def _is(entry: Record, wanted: Mapping[str, str]) -> bool:
    return all(entry[name] == value for name, value in wanted.items())


def _compared(race: Record, other: Record, whole: Record) -> list[str]:
    keys = other["key"], whole["key"]
    pair = next(pair for pair in race["pairs"] if {pair["first"], pair["second"]} == set(keys))
    if pair["estimate"] is None:
        return ["–", "not comparable"]
    there = {name: pair[name] for name in ENDS}
    if pair["first"] != keys[0]:
        there = {"estimate": 1 / pair["estimate"], "low": 1 / pair["high"], "high": 1 / pair["low"]}
    verdict = "no difference" if not pair["differ"] else "worse without" if there["estimate"] > 1 else "better without"
    return [_interval(there), verdict]


def _interval(ratio: Record) -> str:
    if ratio["estimate"] is None:
        return "–"
    return ratio_words(Interval(*(ratio[name] for name in ENDS)))


def _below(ratio: Record) -> str:
    if ratio["estimate"] is None:
        return "–"
    return below_words(Interval(*(ratio[name] for name in ENDS)))


def _figures(runs: Record) -> list[str]:
    means = runs["statistics"]
    chatter = means["mean.chatter"]
    return [_rms(means["mean.mse"]), "–" if chatter is None else f"{chatter:.3g}"]


def _rms(mean_square: float | None) -> str:
    return "–" if mean_square is None else f"{MILLIMETRES * math.sqrt(mean_square):.3g}"


def _constraints(runs: Record, race: Record) -> str:
    lost = race["test_scenarios"] - runs["completed"]
    if lost:
        return f"{lost} not completed"
    return f"violated: {runs['violated'][0]}" if runs["violated"] else "satisfied"


def _read(folder: Path) -> Record:
    return json.loads((folder / "race.json").read_text(encoding="utf-8"))


def main() -> None:
    """Print or write the tables of a race."""
    parser = command(__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="of `dualwinch race`")
    parser.add_argument("--figures", type=Path, metavar="FOLDER", help="where the figures are copied to")
    arguments = parser.parse_args()
    race = _read(arguments.folder)
    texts = {
        "claims": claims_table(race),
        "race": f"{race_table(race)}\n\n{facts(race)}",
        "least error": least(race),
    }
    publish(arguments.write, texts)
    if arguments.figures:
        for name, copied in FIGURES.items():
            shutil.copyfile(arguments.folder / name, arguments.figures / copied)


if __name__ == "__main__":
    main()
