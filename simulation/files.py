"""Files that appear whole or not at all (see `codegen.files`)."""

from codegen.files import atomic

__all__ = ["atomic"]
