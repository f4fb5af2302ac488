"""A figure of merit of one's own: how fast a rope ages, as an objective and a bound of tuning."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import annotated_types as at

import dualwinch as dw


@dataclass(frozen=True)
class Ageing:
    """What rope 1 has been through: last tension and turning point in N, 1 up or -1 down, and the damage by then."""

    F1: float = 0.0
    turn: float = 0.0
    direction: float = 0.0
    damage: float = 0.0


@dataclass(frozen=True)
class RopeAgeing(dw.Metric):
    """Swings of tension 1 between two of its turning points, each to the power of Wöhler's exponent."""

    exponent: Annotated[float, at.Ge(1), dw.Quantity("1", "Wöhler exponent of wire rope")] = 5.0

    kind: ClassVar = "rope-ageing"
    quantity: ClassVar = dw.Quantity("1", "damage of rope 1, in swings of 1 kN")

    def initial_state(self):
        return Ageing()

    def step(self, state, sample, sample_time):
        direction = dw.where(sample.F1 >= state.F1, 1.0, -1.0)
        turned = (direction != state.direction) * (sample.number > 0)
        swing = abs(state.F1 - state.turn) / 1000
        return Ageing(
            F1=sample.F1,
            turn=dw.where(turned, state.F1, dw.where(sample.number > 0, state.turn, sample.F1)),
            direction=direction,
            damage=state.damage + dw.where(turned, swing**self.exponent, 0.0),
        )

    def value(self, state, samples):
        return state.damage


def main(trials: int = 144, out: str = "ageing") -> None:
    """Tune for little error and half of the paper's ageing in a noisy sea, compare, write the controller's C."""
    start = dw.case(4, estimator=dw.CalibratingKalman(), metrics=[RopeAgeing()])
    constraints = ["worst.peak_tension<=6000", "mean.rope_ageing<=0.5*paper"]
    tuned = dw.tune(dw.tuning_problem(start, ensemble="sea", constraints=constraints), trials=trials)
    print(tuned)
    sea = dw.load_ensemble("sea", start)
    comparison = dw.compare({"paper": dw.paper_controller(), "tuned": tuned.best.controller}, sea, 40, seed=7)
    print(comparison)
    for name, contender in comparison.contenders.items():
        print(f"{name}: mean ageing {contender.metrics['rope_ageing'].mean():.3g}")
    print("wrote", *dw.export_c(tuned.best, out))


if __name__ == "__main__":
    main()
