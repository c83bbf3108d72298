"""A program: the markers of a C3D file (motion capture), as an .npz of arrays, read by ezc3d.

    python c3d_program.py FILE RESULT

Run in a process of its own by `palpate.validation.metrics.measured_tracks`: a damaged file may end
it in any way. Imports nothing of palpate.
"""

from __future__ import annotations

import sys

import numpy as np


def main(file: str, result: str) -> int:
    """Read, and write labels, times [s] and positions in the file's unit; NaN where lost."""
    import ezc3d

    data = ezc3d.c3d(file)
    about = data["parameters"]["POINT"]
    points = data["data"]["points"]
    rate = float(about["RATE"]["value"][0])
    first = int(data["header"]["points"]["first_frame"])
    labels = [str(name) for name in about["LABELS"]["value"]][: points.shape[1]]
    # A residual below 0 is the format's word for a marker that was lost.
    residuals = data["data"]["meta_points"]["residuals"][0]
    positions = np.where(residuals[None] < 0.0, np.nan, points[:3])
    np.savez(
        result,
        labels=np.array(labels, dtype=str),
        unit=np.array(str(about["UNITS"]["value"][0]).strip(), dtype=str),
        time=(first + np.arange(points.shape[2])) / rate,
        positions=positions.transpose(1, 2, 0),
    )
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(*sys.argv[1:]))
    except Exception as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        sys.exit(1)
