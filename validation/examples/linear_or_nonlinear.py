# %% [markdown]
# # Linear or nonlinear, for my organ?
# Linear strain is one linear solve, Green strain some more. How far the first may be trusted
# depends on the load: solve both, from small to large.

# %%
import dataclasses

import numpy as np

import palpate

problem = palpate.load_case("kidney").problem


def scaled(factor: float) -> palpate.Problem:
    """The same problem, pulled more or less."""
    (pull,) = problem.loads
    assert isinstance(pull, palpate.Traction)
    x, y, z = (factor * t for t in pull.traction)
    return dataclasses.replace(problem, loads=(palpate.Traction(pull.facets, (x, y, z)),))


# %%
errors = {}
for factor in (0.05, 0.2, 0.8):
    linear = palpate.solve(scaled(factor), strain="linear")
    green = palpate.solve(scaled(factor), strain="green")
    difference = np.linalg.norm(linear.displacement - green.displacement)
    errors[factor] = difference / np.linalg.norm(green.displacement)
    print(f"{factor:4g} of the load: linear strain is off by {100 * errors[factor]:.1f} %")

# %% [markdown]
# `palpate sweep kidney --vary "load[0].factor=0.05:0.8:10" -o out` makes the figures.
