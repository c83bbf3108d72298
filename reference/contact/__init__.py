"""Rigid tools pressed into the body."""
