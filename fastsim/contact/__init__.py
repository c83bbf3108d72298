"""Contact with rigid tools: gaps, forces, equilibria, and what a run may not do."""
