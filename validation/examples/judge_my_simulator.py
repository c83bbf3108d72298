# %% [markdown]
# # Judge my simulator
# A simulator is any function from a problem to displacements, or a command that reads a case
# folder and writes a result. Here it is a function that is wrong by 2 % in Young's modulus.

# %%
import dataclasses

import numpy as np
from numpy.typing import NDArray

import palpate

case = palpate.load_case("block")
print(case.title, case.problem.mesh.num_cells, "cells")


# %%
def softer(problem: palpate.Problem) -> NDArray[np.float64]:
    """My simulator, 2 % too soft."""
    young = problem.material.youngs_modulus / 1.02
    material = dataclasses.replace(problem.material, youngs_modulus=young)
    return palpate.solve(dataclasses.replace(problem, material=material)).displacement


# %% [markdown]
# The verdict comes with every check: its number, its limit, and the reason for the limit.

# %%
result = palpate.judge(case, softer)
print(result.verdict)
for check in result.checks:
    print(check.verdict, check.metric, check.against, check.message)

# %% [markdown]
# palpate looks for an explanation, trying one hypothesis at a time.

# %%
for diagnosis in result.diagnoses:
    print(diagnosis)
