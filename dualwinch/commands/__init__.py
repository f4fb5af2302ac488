"""What the commands do, one a file; their options stand in `dualwinch.cli`."""
