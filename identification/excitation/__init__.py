"""Which run to make: references that make a machine's numbers visible."""
