"""Repair that takes exact predicates: surfaces that cut themselves, and surfaces made anew."""
