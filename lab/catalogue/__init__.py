"""What a page has to know of the closed loop, as data."""
