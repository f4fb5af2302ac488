"""Pictures of the control, drawn as SVG by ``python -m docs.pictures``."""
