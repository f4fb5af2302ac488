"""What breaks first: imperfections of a machine made larger, one by one, until gains no longer keep to what they must."""
