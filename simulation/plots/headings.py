"""What a figure of runs says of the experiment they are runs of."""

from collections.abc import Sequence

from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import CASES, FIGURES, case


def case_number(experiment: Experiment) -> int | None:
    """The paper's case whose reference and disturbance an experiment has; ``None`` for another."""
    for number in CASES:
        paper = case(number)
        if (paper.reference, paper.disturbance) == (experiment.reference, experiment.disturbance):
            return number
    return None


def scenario(experiment: Experiment) -> str:
    """Reference and disturbances in words."""
    number = case_number(experiment)
    if number is not None:
        return CASES[number]
    disturbance = experiment.disturbance
    sources = {
        "vortex shedding": disturbance.vortex,
        "current": disturbance.current_sigma > 0 or disturbance.current.given,
        "varying rail load": disturbance.normal_force_sigma > 0 or disturbance.normal_force_variation.given,
        "given force": disturbance.force.given,
    }
    words = [name for name, present in sources.items() if present]
    reference = {"uniform": "uniform speed", "file": "recorded motion"}
    return ", ".join(
        [reference.get(experiment.reference.kind, experiment.reference.kind), *(words or ["no disturbance"])]
    )


def headings(experiments: Sequence[Experiment], content: str, words: str) -> tuple[str, str]:
    """Title and subtitle of a figure of runs; the paper's number of the figure where all are of one of its cases.

    Args:
        experiments: what was run.
        content: one of `simulation.paper.CONTENTS`.
        words: what is drawn, for the title.
    """
    numbers = {case_number(experiment) for experiment in experiments}
    shown = [figure for figure in FIGURES if {figure.case} == numbers and figure.content == content]
    title = words[0].upper() + words[1:]
    for figure in shown:
        title = f"Figure {figure.number} · Case {figure.case}: {words}"
    scenarios = dict.fromkeys(map(scenario, experiments))
    return title, "; ".join(scenarios).capitalize()
