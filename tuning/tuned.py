"""Tuned gains, as a notebook and a prompt show them."""

from dualwinch.model.quantities.html import page, section, table
from dualwinch.tuning.finished import Finished
from dualwinch.tuning.summary import authority, contenders, endings, headline, statistics_table, worth


class Tuned(Finished):
    """A finished study that shows what it has found; fields are those of `Finished`."""

    def __repr__(self) -> str:
        return f"Tuned({'; '.join(filter(None, (worth(self), headline(self), authority(self))))})"

    def _repr_html_(self) -> str:
        """As a notebook shows it."""
        headings, rows = statistics_table(self)
        words = [headline(self), endings(self), authority(self), *contenders(self)]
        gains = [[key, f"{value:.6g}" if isinstance(value, float) else str(value)] for key, value in self.gains.items()]
        return page(
            worth(self),
            ". ".join(filter(None, words)),
            section("statistics", table(headings, rows, numbers=range(1, len(headings) - 1)), is_open=True),
            section("tuned gains", table(["key", "value"], gains, numbers=(1,)), is_open=True),
        )
