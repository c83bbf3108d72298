"""From solutions to a verdict, and what is written of it."""
