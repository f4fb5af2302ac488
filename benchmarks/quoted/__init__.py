"""Tables and sentences of the documents that rest on runs, a function each, which a command writes into the pages."""
