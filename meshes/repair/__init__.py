"""Repair of surfaces that bound no solid: holes, sheets, shells; without exact predicates."""
