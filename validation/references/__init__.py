"""The reference solutions of the cases: made, stored, compared, accepted."""
