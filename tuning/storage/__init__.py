"""Where a study is kept: memory, a journal file, or a database that many workers share."""
