"""Results of a run: what they hold, files of them, and other forms and time grids for them."""
