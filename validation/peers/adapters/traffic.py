"""Bytes that a step moves, counted from its arrays, and the highest rate that they allow.

An array counts once for each launch that reads or writes it from end to end; points that several
cells read are assumed to come from the cache after the first. What acts on the boundary alone
(pressure, supports, tools) is left out. The result is an upper bound of the rate, no measurement:

    rate <= bandwidth / (bytes per cell and step)

For the box of 600 000 cells of `palpate bench steps`, with 0.18 points a cell, in repeatable mode:

    bytes per cell and step      float32   float64
    linear tetrahedra                190       347
    smoothed ones                    476       813

At the 3.35 TB/s that NVIDIA states for the memory of an H100 SXM, linear tetrahedra make at most
17.6 thousand million cells x steps per second in float32 and 9.7 in float64, if the memory gives
all it can and nothing else delays the kernels: on paper, not measured on a device.
"""

from __future__ import annotations

from typing import Any

from palpate.fastsim.explicit_body import ExplicitBody
from palpate.fastsim.gpu.device_run import DeviceRun
from palpate.fastsim.gpu.launches import BLOCK
from palpate.meshes.errors import InputError

# Memory bandwidth of an H100 SXM, by NVIDIA's data sheet [bytes/s].
H100_BANDWIDTH = 3.35e12


def bytes_per_step(body: ExplicitBody) -> int:
    """Bytes read and written in a step by all bodies of the batch that this one runs in.

    Raises:
        InputError: A body of the compiled core.
    """
    if not isinstance(body.run, DeviceRun):
        raise InputError("bytes are counted of bodies on a device")
    launches = body.run.batch.launches
    m, cells, scheme = launches.motion, launches.mesh, launches.scheme
    at_rest = _size(cells.corners, cells.gradients, cells.volumes)
    if cells.patches is None:
        kinds = _size(cells.kinds) if cells.num_kinds > 1 else 0
        forces = at_rest + kinds + _size(m.displacement)
    else:
        p = cells.patches
        forces = at_rest + _size(m.displacement, p.strains)
        forces += _size(p.strains, *p.edges, p.edge_weights, p.edge_kinds, p.stresses)
        forces += _size(p.strains, *p.nodes, p.node_weights, p.node_kinds, p.pressures)
        forces += at_rest + _size(m.displacement, p.cell_edges, p.cell_nodes)
        forces += _size(p.stresses, p.pressures)
    if cells.cell_forces.size:
        gathered = _size(cells.cell_forces) + _size(cells.cell_forces, *cells.gather, m.force)
    else:
        gathered = 3 * _size(m.force)  # it is cleared, then read and written by the sums
    moved = _size(m.external, m.force, scheme.mobility) + 2 * _size(m.increment, m.displacement)
    looked = _size(m.mass, m.is_free, m.external, m.increment, m.displacement)
    looked += 2 * _size(m.counted, m.given, m.increment, m.displacement)
    return int(forces + gathered + moved + looked / BLOCK)


def paper_rate(bytes_per_cell: float, bandwidth: float = H100_BANDWIDTH) -> float:
    """Cells x steps per second that a bandwidth [bytes/s] allows at most."""
    return bandwidth / bytes_per_cell


def copy_bandwidth(body: ExplicitBody, *, megabytes: int = 256) -> float:
    """Bandwidth of copies on the body's device, bytes read and written [bytes/s].

    Raises:
        InputError: A body of the compiled core.
    """
    if not isinstance(body.run, DeviceRun):
        raise InputError("copies are timed on a device")
    return body.run.batch.launches.copy_bandwidth(megabytes * 1_000_000)


def _size(*arrays: Any) -> int:
    """Number of bytes of all arrays."""
    return sum(int(array.capacity) for array in arrays)
