"""FMUs in other people's hands: every importer that is installed runs the same Case 4."""
