"""Storage of studies: memory, a journal file, or a database shared by many workers."""
