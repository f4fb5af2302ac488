"""Blocks as Structured Text (IEC 61131-3) for PLCs, with the projects of their programming systems."""
