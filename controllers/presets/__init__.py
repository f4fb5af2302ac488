"""Controllers by name: gains designed for a machine."""
