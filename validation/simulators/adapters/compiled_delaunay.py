"""Delaunay tetrahedra by C++ libraries, compiled when the benchmark runs."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
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
LIBRARIES = {
    "cgal": (_CGAL, ("-DCGAL_NDEBUG", "-lgmp", "-lmpfr")),
    "tetgen": (_TETGEN, ("-ltet",)),
}


def compile_library(name: str, folder: Path) -> Path | None:
    """Compile one against the system's headers; None where that does not work."""
    compiler = shutil.which("g++") or shutil.which("c++")
    if compiler is None:
        return None
    text, options = LIBRARIES[name]
    source, target = folder / f"{name}.cpp", folder / f"{name}.so"
    source.write_text(text, encoding="ascii")
    command = [compiler, "-O3", "-DNDEBUG", "-std=c++17", "-w", "-fPIC", "-shared"]
    done = subprocess.run(
        [*command, source, "-o", target, *options], capture_output=True, check=False, timeout=300
    )
    return target if done.returncode == 0 else None


class Delaunay:
    """The library takes over the points beforehand.

    The job names a library, and under its name where it was compiled to, nothing if it was not.
    """

    precision = "float64"

    def __init__(self, job: dict[str, Any]) -> None:
        library = str(job[str(job["library"])])
        if not library:
            raise ImportError("it did not compile: no compiler, or no headers")
        self._library = ctypes.CDLL(library)
        self._library.version.restype = ctypes.c_char_p
        self._library.count.restype = ctypes.c_long
        self.version = self._library.version().decode()
        points = np.ascontiguousarray(job["points"])
        self._library.take(
            points.ctypes.data_as(ctypes.POINTER(ctypes.c_double)), ctypes.c_long(len(points))
        )

    def advance(self, _num_steps: int) -> None:
        """From points to cells."""
        self._library.triangulate()

    @property
    def answer(self) -> dict[str, Any]:
        """How many cells."""
        return {"num_cells": np.array(self._library.count())}
