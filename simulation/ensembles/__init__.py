"""Ensembles: experiments with drawn values, their runs, statistics and files; paired comparisons."""
