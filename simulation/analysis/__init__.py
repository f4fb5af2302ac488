"""Analysis of the closed loop: linearisation, margins, the stability theorem, bounds of any controller."""
