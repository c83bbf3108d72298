"""Adapters: one file sets up and runs each tool, for `gate --simulator` and `palpate bench`.

A file has a class for each task that its tool can do, with the arrays of its result:

    Static                equilibrium; displacement
    Motion                a motion; displacement and times
    Steps                 explicit steps; force, at the job's test displacement
    Collision             vertices in cells, frame by frame; pairs, of the first frame
    Mesh, Delaunay        tetrahedra in a surface, of points; points and cells, num_cells
    Surface               triangles on a body; points and facets

    version, precision    text
    __init__(job)         sets up, from a dict of plain arrays
    advance(num_steps)    the work that is timed; may return more columns for the row
    result                the arrays named above, once they are there

`__init__` raises ImportError where the tool is not installed, and ValueError where it cannot do the
job. A file with `Static` or `Motion` solves case folders too: `python ADAPTER.py CASE RESULT.npz
[NAME=VALUE ...]`; the named values go to the job.

Only ours.py imports anything of palpate, so that an adapter runs in the interpreter that has its
tool; what several of them need is in harness.py and nodes.py beside them: a tool that only makes
time steps derives from `harness.Stepped`, which brings it to rest or through a motion.
`numpy_dense.py` needs neither: copy that one for a simulator of your own. A new adapter is a file
here and a row of `peers/registry.toml`.
"""
