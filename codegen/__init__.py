"""From a CasADi function to compiled code: C source, compiler discovery, library cache, rollout driver."""
