"""A case looked at before it is solved: sizes, loads, what it will cost, what looks wrong."""
