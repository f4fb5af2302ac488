"""Functional Mock-up Units of a block: model description, C sources and binaries of FMI 2 and FMI 3."""
