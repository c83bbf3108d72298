"""The explicit step on devices, by Warp: one source for a GPU and for the processor.

Only this package imports Warp, and only inside functions: everything else works without it.
A step is a sequence of launches, each over all bodies of a batch and their cells or points:

1. `kernels/elasticity.py` or `kernels/smoothing.py`: forces of each cell on its corners
2. `kernels/gathering.py`: summed at each point, always in the same order (repeatable), or added by
   atomic operations in any order (fast)
3. `kernels/loading.py`: dead loads, follower pressure, supports that move or slide
4. `kernels/touching.py`: tools
5. `kernels/stepping.py`: eq. 12, and the count of steps
6. `kernels/energy.py`: the balance of energy, and the monitor of its growth

Equations and order are the core's (core/explicit). Points keep the caller's numbers, so that
arrays are shared as they are; cells are sorted along a curve that fills the space.
"""
