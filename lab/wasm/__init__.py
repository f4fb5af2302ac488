"""The closed loop as WebAssembly: what a module takes and gives, its C source, and its build."""
