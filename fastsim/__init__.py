"""The candidate: a lightweight explicit finite-element simulator of soft tissue."""
