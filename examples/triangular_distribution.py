"""A distribution of one's own: a payload that is most often near one mass, and never far from it."""

from dataclasses import dataclass, replace
from math import sqrt
from typing import Annotated, ClassVar

import dualwinch as dw


@dw.register
@dataclass(frozen=True)
class Triangular(dw.Distribution):
    """Between `low` and `high`, most likely near `mode`."""

    low: Annotated[float, dw.Quantity("", "least value")]
    mode: Annotated[float, dw.Quantity("", "most likely value")]
    high: Annotated[float, dw.Quantity("", "largest value")]

    kind: ClassVar = "triangular"

    def quantile(self, share):
        rise, fall, width = self.mode - self.low, self.high - self.mode, self.high - self.low
        if share * width < rise:
            return self.low + sqrt(share * rise * width)
        return self.high - sqrt((1 - share) * fall * width)

    @property
    def ends(self):
        return self.low, self.high


def main(trials: int = 144, out: str = "payload") -> None:
    """Tune in a sea with such a payload, compare the gains with the paper's there, write their C."""
    sea, payload = dw.load_ensemble("sea"), dw.Drawn(Triangular(0.95, 1.0, 1.15), relative=True)
    loaded = replace(sea, name="loaded sea", distributions={**sea.distributions, "plant.vehicle.mass": payload})
    tuned = dw.tune(dw.tuning_problem(ensemble=loaded), trials=trials)
    print(tuned)
    print(dw.compare({"paper": dw.paper_controller(), "tuned": tuned.best.controller}, loaded, scenarios=40, seed=7))
    print("wrote", *dw.export_c(tuned.best, out))


if __name__ == "__main__":
    main()
