"""From CasADi expressions to C source."""
