"""Collision (section IV of the paper): who touches whom, found by spatial hashing."""
