"""Pictures of machine and control, drawn as SVG by ``python -m docs.pictures``."""
