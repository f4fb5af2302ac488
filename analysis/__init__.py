"""Analysis of the closed loop: linearisation, margins, the stability theorem, performance bounds."""
