"""HTML reports, and the paper's errata and claims."""
