"""Export of blocks for other tools: C packages, PLC code, MEX functions, CasADi files."""
