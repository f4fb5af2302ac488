"""Results of runs: columns, outcomes and figures of merit, other forms and time grids, and files."""
