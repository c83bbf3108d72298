"""The tools of `palpate bench delaunay`, each in a child process: `python -m ... TOOL POINTS`.

POINTS holds raw doubles, three for a point. Seconds are CPU time from the points in memory to
the cells in the tool's own memory.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from palpate.meshes.arrays import Points
from palpate.validation.benchmarks.child import peak_memory_mb

Timing = tuple[float, int, str]  # CPU seconds, cells, version

# C++ rivals are compiled when the benchmark runs, against what the system has.
_MAIN = """
#include <cstdio>
#include <cstring>
#include <ctime>
#include <vector>
static double cpu() {
    timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}
static double peak_mb() {
    char line[256];
    long kilobytes = 0;
    FILE *status = std::fopen("/proc/self/status", "r");
    while (status && std::fgets(line, sizeof line, status))
        if (!std::strncmp(line, "VmHWM:", 6)) std::sscanf(line + 6, "%ld", &kilobytes);
    if (status) std::fclose(status);
    return double(kilobytes) / 1024.0;
}
int main(int, char **argv) {
    FILE *file = std::fopen(argv[1], "rb");
    std::fseek(file, 0, SEEK_END);
    const long size = std::ftell(file) / long(sizeof(double));
    std::rewind(file);
    std::vector<double> x(size);
    if (std::fread(x.data(), sizeof(double), x.size(), file) != x.size()) return 1;
    std::fclose(file);
    double seconds = 0.0;
    const long cells = triangulate(x, seconds);
    std::printf("{\\"seconds\\": %.9f, \\"cells\\": %ld, \\"peak_memory_mb\\": %.1f, "
                "\\"version\\": \\"%s\\"}\\n", seconds, cells, peak_mb(), version);
}
"""
_CGAL = """
#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/version.h>
#include <vector>
static double cpu();
static const char *version = CGAL_VERSION_STR;
static long triangulate(std::vector<double> &x, double &seconds) {
    using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
    std::vector<Kernel::Point_3> points;
    for (std::size_t i = 0; i + 2 < x.size(); i += 3)
        points.emplace_back(x[i], x[i + 1], x[i + 2]);
    std::vector<double>().swap(x);
    const double start = cpu();
    CGAL::Delaunay_triangulation_3<Kernel> cells(points.begin(), points.end());
    seconds = cpu() - start;
    return long(cells.number_of_finite_cells());
}
"""
_TETGEN = """
#define TETLIBRARY
#include <tetgen.h>
#include <vector>
static double cpu();
static const char *version = "1.5";
static long triangulate(std::vector<double> &x, double &seconds) {
    tetgenio in, out;
    in.numberofpoints = int(x.size() / 3);
    in.pointlist = new double[x.size()];
    for (std::size_t i = 0; i < x.size(); ++i) in.pointlist[i] = x[i];
    std::vector<double>().swap(x);
    char switches[] = "Q";
    const double start = cpu();
    tetrahedralize(switches, &in, &out);
    seconds = cpu() - start;
    return out.numberoftetrahedra;
}
"""
PROGRAMS = {
    "CGAL (C++)": (_CGAL, ("-DCGAL_NDEBUG", "-lgmp", "-lmpfr")),
    "TetGen 1.5 (C++)": (_TETGEN, ("-ltet",)),
}


def compile_program(tool: str, folder: Path) -> Path | None:
    """Compile a C++ rival against the system's headers; None where that does not work."""
    compiler = shutil.which("g++") or shutil.which("c++")
    if compiler is None:
        return None
    text, options = PROGRAMS[tool]
    source = folder / f"{tool.split()[0].lower()}.cpp"
    source.write_text(text + _MAIN, encoding="ascii")
    target = source.with_suffix("")
    flags = ["-O3", "-DNDEBUG", "-std=c++17", "-w"]
    done = subprocess.run(
        [compiler, *flags, str(source), "-o", str(target), *options],
        capture_output=True,
        check=False,
        timeout=300,
    )
    return target if done.returncode == 0 else None


def _palpate(points: Points) -> Timing:
    from palpate.fastsim import _core
    from palpate.fastsim.mesher import delaunay

    start = time.process_time()
    cells, _ = delaunay(points)
    return time.process_time() - start, len(cells), _core.__version__


def _cgal(points: Points) -> Timing:
    from importlib.metadata import version

    from CGAL.CGAL_Kernel import Point_3
    from CGAL.CGAL_Triangulation_3 import Delaunay_triangulation_3

    rows = [Point_3(*row) for row in points.tolist()]
    start = time.process_time()
    cells = Delaunay_triangulation_3(rows)
    seconds = time.process_time() - start
    return seconds, cells.number_of_finite_cells(), version("cgal")


def _tetgen(points: Points) -> Timing:
    from tetgen import __version__, _tetgen

    mesher = _tetgen.PyTetgen()
    mesher.load_mesh(points, np.empty((0, 3), dtype=np.int32))
    start = time.process_time()
    mesher.tetrahedralize(switches_str="Q")
    return time.process_time() - start, mesher.n_cells, __version__


def _gmsh(points: Points) -> Timing:
    import gmsh

    gmsh.initialize([], interruptible=False)
    gmsh.option.setNumber("General.Verbosity", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    flat = points.ravel()
    start = time.process_time()
    cells, *_ = gmsh.algorithm.tetrahedralize(flat)
    seconds = time.process_time() - start
    gmsh.finalize()
    return seconds, len(cells) // 4, gmsh.__version__


def _qhull(points: Points) -> Timing:
    import scipy
    from scipy.spatial import Delaunay

    start = time.process_time()
    cells = Delaunay(points).simplices
    return time.process_time() - start, len(cells), scipy.__version__


TOOLS: dict[str, Callable[[Points], Timing]] = {
    "palpate": _palpate,
    "CGAL (Python)": _cgal,
    "TetGen (Python)": _tetgen,
    "gmsh": _gmsh,
    "Qhull (scipy)": _qhull,
}

# What a rival's interpreter must have.
NEEDS = {
    "CGAL (Python)": "CGAL",
    "TetGen (Python)": "tetgen",
    "gmsh": "gmsh",
    "Qhull (scipy)": "scipy",
}


def _main() -> None:
    tool, source = sys.argv[1:]
    points = np.fromfile(source).reshape(-1, 3)
    seconds, cells, version = TOOLS[tool](points)
    answer = {"seconds": seconds, "cells": cells, "version": version}
    print(json.dumps({**answer, "peak_memory_mb": peak_memory_mb()}), flush=True)


if __name__ == "__main__":
    _main()
