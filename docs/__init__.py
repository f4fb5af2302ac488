"""The documentation site: pages, and what of them is made of the program itself."""
