"""Contact of the body with rigid tools."""
