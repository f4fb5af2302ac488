"""Linear analysis of the plant: operating points, exact linear models, their modes, zeros and files."""
