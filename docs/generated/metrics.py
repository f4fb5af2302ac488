"""Every figure of merit with its unit and its formula."""

from docs.generated.text import code, table, unit
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.html import readable
from dualwinch.simulation.metrics.metrics import Metrics

FORMULAS = {
    "mae": r"\frac{1}{N}\sum_k \lvert e_k\rvert",
    "max_abs_error": r"\max_k \lvert e_k\rvert",
    "mse": r"\frac{1}{N}\sum_k e_k^2",
    "steady_mae": r"\frac{1}{N_s}\sum_{k\in S} \lvert e_k\rvert",
    "steady_max_abs_error": r"\max_{k\in S} \lvert e_k\rvert",
    "steady_mse": r"\frac{1}{N_s}\sum_{k\in S} e_k^2",
    "saturated_share": r"\frac{1}{N}\sum_k [u_k \ne u_{\mathrm{sat},k}]",
    "torque_saturated_share": r"\frac{1}{N}\sum_k [\tau_{1,k}\ \mathrm{or}\ \tau_{2,k}\ \mathrm{at\ a\ limit}]",
    "slack_share": r"\frac{1}{N}\sum_k [\min(F_{1,k}, F_{2,k}) \le 0]",
    "peak_tension": r"\max_k \max(F_{1,k}, F_{2,k})",
    "min_tension": r"\min_k \min(F_{1,k}, F_{2,k})",
    "chatter": r"\frac{1}{2(N-1)}\sum_{k\ge 1}\sum_i \lvert F_{i,k}-F_{i,k-1}\rvert",
    "energy": r"T_s\sum_k \sum_i \lvert G_i\,\tau_{i,k}\,\omega_{i,k}\rvert",
    "torque_rate": r"\frac{1}{2(N-1)\,T_s}\sum_{k\ge 1}\sum_i \lvert \tau_{i,k}-\tau_{i,k-1}\rvert",
    "continuous_load": r"\sqrt{\frac{1}{2N}\sum_k \sum_i \tau_{i,k}^2}",
}
"""Name → formula: N samples k of T_s, of which the N_s in S are the steady state; i is the winch."""


def metrics_markdown() -> str:
    """A table of all figures of merit."""
    rows = [
        [code(name), unit(leaf.quantity.unit), f"${FORMULAS[name]}$", readable(leaf.quantity.meaning)]
        for name, leaf in describe(Metrics).items()
    ]
    return table(["name", "unit", "formula", "meaning"], rows)
