"""Delaunay tetrahedra by C++ libraries, compiled when a benchmark runs; or by CGAL from Python."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

_CGAL = """
#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/version.h>
#include <vector>
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
static std::vector<Kernel::Point_3> points;
static CGAL::Delaunay_triangulation_3<Kernel> cells;
extern "C" {
const char *version() { return CGAL_VERSION_STR; }
void take(const double *x, long n) {
    for (long i = 0; i < n; ++i) points.emplace_back(x[3 * i], x[3 * i + 1], x[3 * i + 2]);
}
void triangulate() { cells.insert(points.begin(), points.end()); }
long count() { return long(cells.number_of_finite_cells()); }
}
"""
_TETGEN = """
#define TETLIBRARY
#include <algorithm>
#include <tetgen.h>
static tetgenio in, out;
extern "C" {
const char *version() { return "1.5"; }
void take(const double *x, long n) {
    in.numberofpoints = int(n);
    in.pointlist = new double[3 * n];
    std::copy(x, x + 3 * n, in.pointlist);
}
void triangulate() {
    char switches[] = "Q";
    tetrahedralize(switches, &in, &out);
}
long count() { return out.numberoftetrahedra; }
}
"""
_LIBRARIES = {
    # Thread-local variables cost a shared library a sixth of its time, and there is one thread.
    "cgal": (_CGAL, ("-DCGAL_NDEBUG", "-DCGAL_HAS_NO_THREADS", "-lgmp", "-lmpfr")),
    "tetgen": (_TETGEN, ("-ltet",)),
}


class Delaunay:
    """The library takes the points beforehand; the job's `folder` stores it compiled."""

    precision = "float64"

    def __init__(self, job: dict[str, Any]) -> None:
        self._triangulate: Callable[[], Any]
        self._count: Callable[[Any], int]
        points, library = np.ascontiguousarray(job["points"]), str(job["library"])
        if library == "cgal from Python":
            from CGAL.CGAL_Kernel import Point_3
            from CGAL.CGAL_Triangulation_3 import Delaunay_triangulation_3

            self.version = version("cgal")
            made = [Point_3(*row) for row in points.tolist()]
            self._triangulate = lambda: Delaunay_triangulation_3(made)
            self._count = lambda cells: cells.number_of_finite_cells()
            return
        compiled = ctypes.CDLL(_compiled(library, Path(str(job["folder"]))))
        compiled.version.restype = ctypes.c_char_p
        compiled.count.restype = ctypes.c_long
        self.version = compiled.version().decode()
        compiled.take(
            points.ctypes.data_as(ctypes.POINTER(ctypes.c_double)), ctypes.c_long(len(points))
        )
        self._triangulate = compiled.triangulate
        self._count = lambda _cells: compiled.count()

    def advance(self, _num_steps: int) -> None:
        """From points to cells."""
        self._cells = self._triangulate()

    @property
    def result(self) -> dict[str, Any]:
        """The number of cells; CGAL goes through all of them to count."""
        return {"num_cells": np.array(self._count(self._cells))}


def _compiled(name: str, folder: Path) -> str:
    """The library, compiled with the system's headers unless it exists already."""
    source, target = folder / f"{name}.cpp", folder / f"{name}.so"
    if not target.exists():
        text, options = _LIBRARIES[name]
        source.write_text(text, encoding="ascii")
        command = ["g++", "-O3", "-DNDEBUG", "-std=c++17", "-w", "-fPIC", "-shared"]
        try:
            subprocess.run(
                [*command, source, "-o", target, *options], capture_output=True, check=True
            )
        except (OSError, subprocess.CalledProcessError) as error:
            raise ImportError("there is no compiler, or no header or library of it") from error
    return str(target)
