"""Surfaces that bound no solid, mended: holes, sheets, shells; by numbers alone, no predicates."""
