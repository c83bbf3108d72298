"""Speed beside rivals, in one run; each function returns rows for `palpate bench`."""
