"""One file a tool: how it is set up and run, for `gate --simulator` and for `palpate bench`.

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

`__init__` raises ImportError where the tool is not installed, and ValueError where the job is not
for it. A file with `Static` or `Motion` solves case folders too: `python ADAPTER.py CASE
RESULT.npz [NAME=VALUE ...]`; what is named goes to the job.

Nothing of palpate is imported (but by ours.py), so that an adapter runs in the interpreter that
has its tool; what several of them need stands in harness.py and nodes.py beside them.
`numpy_dense.py` needs neither: copy that one for a simulator of your own. A new adapter is a file
here and a row of `peers/registry.toml`.
"""
