"""Which bits of a run depend on processor and compiler: the table of docs/many-machines.md.

``python -m benchmarks.bits`` prints it; ``--write FILE`` puts it between the file's two marks.
"""

import os
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from benchmarks.document import command, markdown, publish
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.simulation.ensembles.run import run_ensemble

SEED = 1

COMPILERS = {
    "AVX-512": "gcc -march=native",
    "AVX2": "gcc -march=haswell",
    "no fused products": "gcc -march=x86-64-v2",
    "clang": "clang -march=native",
    "zig": "zig",
}
"""What lanes are compiled with; the others are compared with the first."""


def metrics_with(compiler: str, name: str, *, exact: bool) -> tuple[dict[str, np.ndarray], float]:
    """Figures of merit of 128 runs by a compiler, and processor time in s of a run; in a process of its own."""
    os.environ |= {"DUALWINCH_CC": compiler, "DUALWINCH_EXACT": str(int(exact))}
    ensemble = load_ensemble(name)
    run_ensemble(ensemble, 16, SEED, traces=False, workers=1)
    found, times = run_ensemble(ensemble, 128, SEED, traces=False, workers=1), []
    for _ in range(3):
        begin = time.process_time()
        run_ensemble(ensemble, 128, SEED, traces=False, workers=1)
        times.append(time.process_time() - begin)
    return found.metrics, min(times) / 128


def bits(name: str) -> str:
    """Values that differ between processors and compilers, as a table."""
    rows = []
    for exact in (False, True):
        first: dict[str, np.ndarray] = {}
        for label, compiler in COMPILERS.items():
            with ProcessPoolExecutor(1, get_context("spawn")) as pool:
                found, seconds = pool.submit(metrics_with, compiler, name, exact=exact).result()
            first = first or found
            pairs = [(first[key][np.isfinite(first[key])], found[key][np.isfinite(first[key])]) for key in first]
            differ = sum(int((ours != theirs).sum()) for ours, theirs in pairs)
            apart = [abs(ours - theirs) / np.maximum(abs(ours), 1e-300) for ours, theirs in pairs]
            largest = float(np.concatenate(apart).max())
            count = sum(len(ours) for ours, _ in pairs)
            rows.append(
                [
                    "`--exact`" if exact else "as usual",
                    label,
                    f"{differ} of {count}",
                    f"{largest:.1e}" if differ else "0",
                    f"{1e3 * seconds:.2f} ms",
                ]
            )
    return markdown(["", "compiled for", "values that differ", "largest, relative", "processor time, a run"], rows)


def main() -> None:
    """Print or write the table."""
    publish(command(__doc__).parse_args().write, {"bits": bits("rig")})


if __name__ == "__main__":
    main()
