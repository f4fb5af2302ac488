"""The lab: the closed loop in a browser, compiled to WebAssembly, and what a page has to know of it."""
