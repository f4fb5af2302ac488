"""The paper, claim by claim, and what its errata and assumptions are worth, in numbers.

``python -m benchmarks.paper_claims`` prints the tables (a quarter of a minute); ``--write docs/paper.md`` puts them
between the page's marks.
"""

from dataclasses import replace
from functools import cache

import numpy as np

import dualwinch as dw
from benchmarks.document import command, publish
from benchmarks.paper_effects import LAW, WITHOUT, choices_table, facts_table
from dualwinch.controllers.controller import Controller
from dualwinch.toolboxes.paper.claims import Claim, Verdict, other_observers, verdict_of
from dualwinch.toolboxes.paper.claims import claims as claims_of

PID = "pid-cascade"
SCENARIOS, SEED = 100, 0
"""Of the ensemble that a claim of robustness is tried on."""


@cache
def runs() -> dict[tuple[int, str], dw.Result]:
    """(case, controller) → run."""
    return {(number, law): dw.simulate(dw.case(number, law)) for number in (1, 2, 3, 4) for law in (LAW, WITHOUT, PID)}


def of_runs() -> list[Claim]:
    """The claims that `dualwinch reproduce` looks at."""
    return claims_of(runs(), other_observers(runs()))


def robust() -> Claim:
    """Uncertain plants in a real sea."""
    laws = {law: replace(dw.paper_controller(), law=dw.case(4, law).controller.law) for law in (LAW, WITHOUT, PID)}
    contenders: dict[str, Controller] = dict(laws)
    found = dw.compare(contenders, dw.load_ensemble("sea"), SCENARIOS, SEED)
    errors = {law: np.asarray(found.contenders[law].metrics["mse"]) for law in laws}
    share = 100 * np.mean(errors[LAW] < errors[WITHOUT]), 100 * np.mean(errors[LAW] < errors[PID])
    return Claim(
        "4.4",
        "Robust against several unknown uncertainties.",
        f"In {SCENARIOS} scenarios of [`sea`](ensembles.md) (uncertain plant, current, noise, delay) its mean "
        "square error is "
        f"below that without the observer in {share[0]:.0f} %, and below the PID cascade's in {share[1]:.0f} %.",
        verdict_of(*(bool(each > 95) for each in share)),
    )


def theorem() -> Claim:
    """Section 3.1.5."""
    certificate = dw.certify(dw.case(4))
    failing = [c for c in certificate.conditions if not c.holds and c.basis != "real ropes"]
    return Claim(
        "3.1.5",
        "Stability is proved by Lyapunov's method.",
        f"With the paper's gains {len(failing)} of the theorem's conditions fail, and V decreases over "
        f"{100 * certificate.decreasing:.0f} % of the samples of Case 4. The loop is stable, [with "
        "margins](stability.md); the "
        "proof does not show it.",
        verdict_of(certificate.certified),
    )


def claims() -> list[Claim]:
    """Every claim."""
    return [*of_runs(), robust(), theorem()]


VERDICTS: dict[Verdict, str] = {"holds": "Holds", "partly": "Holds in part", "does not hold": "Does not hold"}


def claims_list() -> str:
    """The claims, those that hold first, each with what is found here."""
    found, lines = claims(), []
    for verdict, heading in VERDICTS.items():
        lines += [f"### {heading}", ""]
        lines += [f"- **{claim.words}** ({claim.section}) {claim.here}" for claim in found if claim.verdict == verdict]
        lines.append("")
    return "\n".join(lines).rstrip()


TABLES = {"claims": claims_list, "choices": choices_table, "facts": facts_table}
"""Mark in the page → what stands there."""


def main() -> None:
    """Print or write the tables."""
    publish(command(__doc__).parse_args().write, {mark: table() for mark, table in TABLES.items()})


if __name__ == "__main__":
    main()
