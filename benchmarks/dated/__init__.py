"""Results of other tools, which do not change from commit to commit: dated, with the commands that measured them."""
