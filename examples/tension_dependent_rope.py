"""A rope law of one's own: a fibre rope that gets stiffer the more it is stretched."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import annotated_types as at

import dualwinch as dw


@dataclass(frozen=True)
class Fibre(dw.RopeLaw):
    """A fibre rope: it gets stiffer the more it is stretched."""

    k1: Annotated[float, at.Gt(0), dw.Quantity("N", "tension over strain of the unstretched rope")] = 4e6
    k2: Annotated[float, at.Ge(0), dw.Quantity("N", "its growth over the strain")] = 8e9
    c: Annotated[float, at.Ge(0), dw.Quantity("N s/m", "axial damping")] = 1000.0

    kind: ClassVar = "fibre"
    label: ClassVar = "fibre rope"

    def tension(self, stretch, stretch_rate, length):
        strain = stretch / length
        return (self.k1 + self.k2 * strain) * strain + self.c * stretch_rate


def main(trials: int = 96, out: str = "fibre") -> None:
    """Tune in a noisy sea on such ropes, compare the gains with the paper's there, write their C."""
    sea = dw.load_ensemble("sea")
    plant = replace(sea.experiment.plant, rope_1=Fibre(), rope_2=Fibre())
    start = replace(sea.experiment, plant=plant, controller=dw.Controller(estimator=dw.CalibratingKalman()))
    drawn = {key.replace("modulus", "k1").replace("damping", "c"): how for key, how in sea.distributions.items()}
    fibres = dw.Ensemble("fibre sea", "sea on fibre ropes", start, drawn)
    print(dw.simulate(dw.case(4, rope=Fibre())))
    tuned = dw.tune(dw.tuning_problem(ensemble=fibres), trials=trials)
    print(tuned)
    print(dw.compare({"paper": dw.paper_controller(), "tuned": tuned.best.controller}, fibres, scenarios=40, seed=7))
    print("wrote", *dw.export_c(tuned.best, out))


if __name__ == "__main__":
    main()
