"""Graded meshes (section V of the paper): fine where it matters, coarse elsewhere."""
