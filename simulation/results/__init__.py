"""Results of runs: outcomes and figures of merit, rows, figures, files."""
