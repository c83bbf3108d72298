"""Kernels, by equation; each file makes its own for one kind of numbers.

These files hold Warp's language inside Python: annotations are types of Warp's, made at run time.
"""
