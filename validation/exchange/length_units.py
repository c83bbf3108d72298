"""Units of length that files may be in."""

# Metres in each.
LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
