"""Kernels, by equation; each file makes its kernels for one precision.

These files hold Warp's language inside Python: annotations are types of Warp's, made at run time.
"""
