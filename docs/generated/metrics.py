"""Every figure of merit with its unit and its formula."""

from docs.generated.text import code, table, unit
from dualwinch.model.quantities.tables import readable
from dualwinch.simulation.metrics.metrics import metric_quantities


def metrics_markdown() -> str:
    """A table of all figures of merit: N samples k of T_s, the N_s in S of them steady; i is the winch."""
    rows = [
        [code(name), unit(quantity.unit), f"${quantity.formula}$", readable(quantity.meaning)]
        for name, quantity in metric_quantities().items()
    ]
    return table(["name", "unit", "formula", "meaning"], rows)
