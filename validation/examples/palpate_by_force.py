# %% [markdown]
# # Find a stiff inclusion by touch
# A controller palpates a soft block along its surface: down to a depth, read the force, up, on to
# the next position. It knows nothing of the block except the force on its probe; where that is
# largest it searches more closely, and reports the position of the hard part.

# %%
import numpy as np

import palpate
from palpate.fastsim.live_body import LiveBody

SIZE, RADIUS, DEPTH = (0.08, 0.04, 0.02), 0.008, 0.002  # m
SPEED = 0.04  # m/s


def block_with_inclusion(center: tuple[float, float, float], radius: float) -> palpate.Problem:
    """A block on a table, a ball in it ten times as stiff, and a probe above one corner."""
    mesh = palpate.mesh(palpate.box(SIZE, edge_length=0.005))
    middles = mesh.points[mesh.cells].mean(axis=1)
    hard = np.flatnonzero(np.linalg.norm(middles - center, axis=1) < radius).astype(np.int32)
    low = np.flatnonzero(mesh.points[:, 2] < 1e-9).astype(np.int32)
    start = np.array([[0.012, 0.012, SIZE[2] + RADIUS + 0.001]])
    probe = palpate.RigidTool(palpate.SphereShape(RADIUS), palpate.ToolPath(np.zeros(1), start))
    return palpate.Problem(
        mesh,
        palpate.Material(5e3, 0.4),
        supports=(palpate.Support(low),),
        loads=(),
        time=palpate.TimeSpan(1.0, mass_damping=100.0),  # only its damping is read
        tools=(probe,),
        inclusions=(palpate.Inclusion(hard, palpate.Material(50e3, 0.4)),),
    )


# %%
def feel(body: LiveBody, x: float, y: float) -> float:
    """The force on the probe at the depth, pressed from above a position [N]."""
    (probe,) = body.tools
    above, touching = SIZE[2] + RADIUS + 0.001, SIZE[2] + RADIUS - DEPTH
    for goal in ((*probe.position[:2], above), (x, y, above), (x, y, touching)):
        way = float(np.linalg.norm(goal - probe.position))
        probe.move_to(goal)
        body.step(1 + round(way / SPEED / body.time_step))
    body.step(round(0.03 / body.time_step))  # come to rest
    body.step(round(0.01 / body.time_step))
    return float(probe.force[2])  # the mean of the last 10 ms


def find_inclusion(problem: palpate.Problem) -> tuple[float, float]:
    """Position on the top where the body is hardest [m]: a coarse search, then a finer one."""
    body = LiveBody(problem)
    felt = {(x, y): feel(body, x, y) for x in np.arange(0.012, 0.07, 0.014) for y in (0.012, 0.028)}
    best = max(felt, key=felt.__getitem__)
    for x in (best[0] - 0.007, best[0], best[0] + 0.007):
        for y in (0.012, 0.020, 0.028):
            if (x, y) not in felt and 0.01 < x < SIZE[0] - 0.01:
                felt[x, y] = feel(body, x, y)
    positions, forces = np.array(list(felt)), np.array(list(felt.values()))
    weights = np.clip(forces - np.median(forces), 0.0, None) ** 2
    x, y = weights @ positions / weights.sum()
    print(f"felt {forces.min():.3f} to {forces.max():.3f} N; hardest at ({x:.3f}, {y:.3f}) m")
    return float(x), float(y)


# %%
found = find_inclusion(block_with_inclusion((0.052, 0.024, 0.012), 0.007))
