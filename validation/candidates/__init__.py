"""The candidates: fastsim, and any program that reads a case folder and writes a result."""
