"""A case solved again and again with other values: linear beside Green strain."""
