"""The judge's own mechanics in NumPy, apart from fastsim and from the reference."""
