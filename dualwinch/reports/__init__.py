"""HTML reports, and the errata that stand in them."""
