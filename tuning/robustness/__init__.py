"""What breaks first: imperfections of a machine made larger until gains no longer keep to what they must."""
