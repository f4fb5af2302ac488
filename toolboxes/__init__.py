"""Toolboxes: each a capability of its own above the kernel; any of them can be left out."""
