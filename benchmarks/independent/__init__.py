"""An independent judge: exported controllers around a machine that shares no code and no draw with the product."""
