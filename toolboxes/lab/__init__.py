"""The lab: the closed loop in a browser, compiled to WebAssembly, and its catalogue for the page."""
