"""The closed loop as WebAssembly: structures, settings, C source and build of its modules."""
