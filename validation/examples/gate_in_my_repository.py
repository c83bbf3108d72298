# %% [markdown]
# # A gate in my repository
# A case is a file in my repository; the gate turns red when my simulator gets worse.
# `palpate init organ.stl -o organ.toml` writes one to start from; in CI,
# `palpate gate organ.toml --simulator "python mysim.py {case} {result}"` does what is below.
# `gate_your_simulator` beside this file is such a repository in full.

# %%
import numpy as np
from numpy.typing import NDArray

import palpate


def mysim(problem: palpate.Problem) -> NDArray[np.float64]:
    """My simulator."""
    return palpate.solve(problem).displacement


# %% [markdown]
# References of the built-in cases are stored: no FEniCSx is needed here.

# %%
verdicts = {}
for name in ("block", "column"):
    verdicts[name] = palpate.judge(name, mysim).verdict
    print(name, verdicts[name])

# %% [markdown]
# A failed or an inconclusive case must not pass unseen.

# %%
is_green = all(verdict is palpate.Verdict.PASSED for verdict in verdicts.values())
print("green" if is_green else "red")
