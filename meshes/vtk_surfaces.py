"""A program: the polygons that VTK reads from a file, as an .npz of arrays; or its cells as a .vtu.

    python vtk_surfaces.py FILE RESULT

Run in a process of its own by `palpate.meshes.surface_files`: a damaged file may end it in any way.
What VTK reports as an error or a warning ends it with 1 and that line, because VTK goes on with the
part of a file that it could read. Imports nothing of palpate.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np


def main(file: str, result: str) -> int:
    """Read, and write points, offsets and corners; 1 where VTK has something to say."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    trouble: list[str] = []

    def observe(_caller: Any, _event: str, text: str) -> None:
        trouble.append(str(text))

    if result.endswith(".vtu"):
        _write_cells(file, result, observe)
        data = None
    else:
        data = _polygons(file, observe)
    if trouble:
        lines = [line.strip() for text in trouble for line in text.splitlines() if line.strip()]
        print(lines[-1], file=sys.stderr)
        return 1
    if data is None:
        return 0
    if data.GetPoints() is None:
        print("no points", file=sys.stderr)
        return 1
    cells = data.GetPolys()
    np.savez(
        result,
        points=vtk_to_numpy(data.GetPoints().GetData()),
        offsets=vtk_to_numpy(cells.GetOffsetsArray()).astype(np.int64),
        corners=vtk_to_numpy(cells.GetConnectivityArray()).astype(np.int64),
    )
    return 0


def _write_cells(file: str, result: str, observer: Any) -> None:
    """A legacy unstructured grid, of any version, with its fields as a .vtu."""
    from vtkmodules.vtkIOLegacy import vtkUnstructuredGridReader
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    observer.CallDataType = "string0"
    reader, writer = vtkUnstructuredGridReader(), vtkXMLUnstructuredGridWriter()
    for one in (reader, writer):
        one.AddObserver("ErrorEvent", observer)
        one.AddObserver("WarningEvent", observer)
    reader.SetFileName(file)
    reader.ReadAllScalarsOn()
    reader.ReadAllVectorsOn()
    reader.ReadAllFieldsOn()
    reader.Update()
    writer.SetFileName(result)
    writer.SetInputData(reader.GetOutput())
    writer.Write()


def _polygons(file: str, observer: Any) -> Any:
    """The vtkPolyData of a file; `observer` gets each error and warning."""
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter
    from vtkmodules.vtkFiltersGeometry import vtkCompositeDataGeometryFilter
    from vtkmodules.vtkIOGeometry import vtkGLTFReader
    from vtkmodules.vtkIOLegacy import vtkPolyDataReader
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    kind = Path(file).suffix.lower()
    readers: dict[str, Any] = {
        ".vtk": vtkPolyDataReader, ".vtp": vtkXMLPolyDataReader,
        ".glb": vtkGLTFReader, ".gltf": vtkGLTFReader,
    }  # fmt: skip
    observer.CallDataType = "string0"
    reader = readers[kind]()
    reader.AddObserver("ErrorEvent", observer)
    reader.AddObserver("WarningEvent", observer)
    reader.SetFileName(file)
    reader.Update()
    data = reader.GetOutputDataObject(0)
    if kind in (".glb", ".gltf"):
        flat = vtkCompositeDataGeometryFilter()
        flat.SetInputDataObject(data)
        flat.Update()
        data = flat.GetOutput()
    # Strips become the triangles they stand for, in the orientation of the first.
    if data.GetNumberOfStrips():
        strips = vtkTriangleFilter()
        strips.SetInputData(data)
        strips.PassLinesOff()
        strips.PassVertsOff()
        strips.Update()
        data = strips.GetOutput()
    return data


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
