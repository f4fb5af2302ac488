"""Blocks as files for other people's tools: C packages, MEX functions, CasADi files."""
