"""Repair by exact predicates: self-intersecting surfaces, and surfaces made anew."""
