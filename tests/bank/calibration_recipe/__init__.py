"""How the problems of `palpate study calibration` and their answers were made.

    PYTHONPATH=tests/bank python -m calibration_recipe

writes validation/studies/calibration.tar.xz anew, after `problems.toml` has changed; every night a
test compares the two.
"""
