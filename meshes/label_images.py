"""Label images, as segmentation tools write them: a whole number for each voxel, 0 for nothing.

NIfTI is read by nibabel, NRRD and MetaImage by SimpleITK: the optional extra `scans`.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.meshes.errors import FileFormatError, InputError, first_of

NIFTI = (".nii.gz", ".nii")
SUFFIXES = (*NIFTI, ".nrrd", ".nhdr", ".mha", ".mhd")
# Voxels of 700^3: their numbers and the masks of one label take some 2 GB.
_MOST_VOXELS = 700**3
# Cosine between two axes of voxels that are at right angles but for float32's rounding.
_RIGHT_ANGLE = 1e-4
# Labels of the phantom by number, and that of what it is attached to.
PHANTOM = {1: "liver", 2: "spleen", 3: "vessel", 4: "tumour"}
PHANTOM_WALLS = {5: "spine"}
_MILLIMETRES = {"mm": 1.0, "unknown": 1.0, "meter": 1000.0, "micron": 0.001}


@dataclass(frozen=True, eq=False)
class LabelImage:
    """Labels of voxels, and where these are.

    Attributes:
        labels: Whole numbers from 0 on, shape (i, j, k).
        affine: From voxel numbers to positions [mm], shape (4, 4); x to the right, y to the front,
            z upwards, as in NIfTI. Its three axes are at right angles.
        path: The file.
    """

    labels: NDArray[np.int32]
    affine: NDArray[np.float64]
    path: str = ""

    @property
    def spacing(self) -> NDArray[np.float64]:
        """Lengths of a voxel's edges [mm], shape (3,)."""
        lengths: NDArray[np.float64] = np.linalg.norm(self.affine[:3, :3], axis=0)
        return lengths

    def line(self) -> str:
        """Size, spacing and orientation in one line."""
        size = " x ".join(map(str, self.labels.shape))
        spacing = " x ".join(f"{x:.4g}" for x in self.spacing)
        names = ("LR", "PA", "IS")
        axes = ""
        for column in self.affine[:3, :3].T:
            main = int(np.argmax(np.abs(column)))
            axes += names[main][int(column[main] > 0)]
        origin = ", ".join(f"{x:.4g}" for x in self.affine[:3, 3])
        return f"{size} voxels of {spacing} mm, axes towards {axes}, the first at ({origin}) mm"


def is_label_image(path: str | Path) -> bool:
    """Whether a file's name ends as those of label images do."""
    return str(path).lower().endswith(SUFFIXES)


def read_labels(path: str | Path) -> LabelImage:
    """Read a label image; see LabelImage.

    Raises:
        FileFormatError: A file that is missing, cut off, not three-dimensional, too large, without
            right angles, or that has other values than whole numbers from 0 on.
        InputError: The library that reads it is not installed.
    """
    path = Path(path)
    if not path.is_file():
        raise FileFormatError(path, "there is no such file")
    read = _read_nifti if str(path).lower().endswith(NIFTI) else _read_itk
    values, affine = read(path)
    _refuse_bad_axes(path, affine)
    return LabelImage(_whole_numbers(path, values), affine, str(path))


def choose_labels(image: LabelImage, names: Mapping[int, str]) -> LabelImage:
    """The image with the named labels alone; all others become 0.

    Raises:
        InputError: A label that no voxel has; the message lists those there are.
    """
    there = np.unique(image.labels)
    there = there[there > 0]
    for label, name in names.items():
        if label not in there:
            raise InputError(
                f"{image.path}: no voxel has the label {label} ({name}); "
                f"there are {first_of(there.tolist(), 20) or 'none but 0'}"
            )
    wanted = np.isin(image.labels, list(names))
    return LabelImage(np.where(wanted, image.labels, 0), image.affine, image.path)


def coarsen(image: LabelImage, edge: float) -> LabelImage:
    """The image with voxels of about a given edge, each of the label that fills most of it.

    A whole number of voxels becomes one along each axis, so that flat voxels become cubes.

    Args:
        image: The image.
        edge: Wanted edge of a voxel [mm], > 0; axes whose voxels are as long stay as they are.

    Raises:
        InputError: A label that is thinner than these voxels would be lost.
    """
    if not (math.isfinite(edge) and edge > 0.0):
        raise InputError(f"voxel edge {edge:g} mm: needs a finite value above 0")
    counts = np.maximum(1, np.rint(edge / image.spacing)).astype(int)
    if (counts == 1).all():
        return image
    blocks = -(-np.array(image.labels.shape) // counts)
    padding = [(0, int(n)) for n in blocks * counts - image.labels.shape]
    shape = [int(n) for pair in zip(blocks, counts, strict=True) for n in pair]
    fine = np.pad(image.labels, padding).reshape(shape)
    labels = np.zeros(blocks, np.int32)
    present = np.setdiff1d(image.labels, [0])
    most = (fine == 0).sum(axis=(1, 3, 5), dtype=np.int32)
    for label in present.tolist():
        share = (fine == label).sum(axis=(1, 3, 5), dtype=np.int32)
        labels[share > most] = label
        np.maximum(most, share, out=most)
    lost = np.setdiff1d(present, labels)
    if lost.size:
        size = " x ".join(f"{x:.3g}" for x in image.spacing * counts)
        raise InputError(
            f"label(s) {first_of(lost.tolist(), 20)}: thinner than voxels of {size} mm, "
            "none of which they fill most of; use smaller ones"
        )
    affine = image.affine.copy()
    affine[:3, 3] = (image.affine @ [*(0.5 * (counts - 1)), 1.0])[:3]
    affine[:3, :3] *= counts
    return LabelImage(labels, affine, image.path)


def make_phantom(count: int = 96) -> LabelImage:
    """Two organs that share a wall, a vessel through one and a tumour in the other; see PHANTOM.

    An ellipsoid of 82 x 58 x 58 mm in a cube of 96 mm around the origin: liver where x < 2.4 mm,
    spleen beyond; the vessel, 14 mm thick, goes through the liver along z, and the tumour, a ball
    of 19 mm, lies in the spleen. Where y < -14.4 mm there is the spine.

    Args:
        count: Voxels along each axis.
    """
    edge = 96.0 / count
    x, y, z = np.meshgrid(*[(np.arange(count) + 0.5) / count * 2 - 1] * 3, indexing="ij")
    labels = np.zeros((count,) * 3, np.int32)
    body = (x / 0.85) ** 2 + (y / 0.6) ** 2 + (z / 0.6) ** 2 < 1
    is_left = body & (x < 0.05)
    labels[body] = 2
    labels[is_left] = 1
    labels[is_left & ((x + 0.35) ** 2 + y**2 < 0.15**2)] = 3
    labels[(x - 0.4) ** 2 + y**2 + z**2 < 0.2**2] = 4
    labels[body & (y < -0.3)] = 5
    affine = np.diag([edge, edge, edge, 1.0])
    affine[:3, 3] = 0.5 * edge - 48.0
    return LabelImage(labels, affine, "phantom")


def _library(name: str, path: Path) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(f'{path}: needs {name}: pip install "palpate[scans]"') from error


def _refuse_size(path: Path, shape: tuple[int, ...]) -> None:
    if len(shape) != 3:
        raise FileFormatError(
            path, f"has {len(shape)} dimensions {shape}; take one volume of three out of it"
        )
    if math.prod(shape) > _MOST_VOXELS or min(shape) < 1:
        raise FileFormatError(
            path,
            f"has {math.prod(shape):.3g} voxels; between 1 and {_MOST_VOXELS:.3g} can be meshed: "
            "crop it to the organs, or resample it (nearest neighbour)",
        )


def _read_nifti(path: Path) -> tuple[NDArray[Any], NDArray[np.float64]]:
    nibabel = _library("nibabel", path)
    try:
        image = nibabel.load(path)
        shape = tuple(image.shape)
        while len(shape) > 3 and shape[-1] == 1:
            shape = shape[:-1]
        _refuse_size(path, shape)
        values = np.asanyarray(image.dataobj).reshape(shape)
        unit = image.header.get_xyzt_units()[0]
    except FileFormatError:
        raise
    except Exception as error:  # nibabel, gzip and zlib each have their own
        raise FileFormatError(path, f"is cut off or no NIfTI file ({error})") from error
    scale = np.diag([*[_MILLIMETRES.get(unit, 1.0)] * 3, 1.0])
    return values, scale @ np.asarray(image.affine, dtype=float)


def _read_itk(path: Path) -> tuple[NDArray[Any], NDArray[np.float64]]:
    itk = _library("SimpleITK", path)
    try:
        reader = itk.ImageFileReader()
        reader.SetFileName(str(path))
        reader.ReadImageInformation()
        if reader.GetNumberOfComponents() != 1:
            raise FileFormatError(path, "has several values for each voxel; labels have one")
        _refuse_size(path, tuple(reader.GetSize()))
        image = reader.Execute()
    except RuntimeError as error:
        why = str(error).strip().splitlines()[-1]
        raise FileFormatError(path, f"is cut off or no image that ITK reads ({why})") from error
    affine = np.eye(4)
    direction = np.reshape(image.GetDirection(), (3, 3))
    affine[:3, :3] = direction * np.asarray(image.GetSpacing())
    affine[:3, 3] = image.GetOrigin()
    # ITK's x is to the left and its y to the back.
    return itk.GetArrayFromImage(image).T, np.diag([-1.0, -1.0, 1.0, 1.0]) @ affine


def _refuse_bad_axes(path: Path, affine: NDArray[np.float64]) -> None:
    axes = affine[:3, :3]
    lengths = np.linalg.norm(axes, axis=0)
    if not np.isfinite(affine).all() or not (lengths > 0.0).all():
        raise FileFormatError(path, "has no usable spacing; set it where the image was made")
    cosines = np.abs((axes / lengths).T @ (axes / lengths) - np.eye(3)).max()
    if cosines > _RIGHT_ANGLE:
        raise FileFormatError(
            path,
            f"has sheared voxels (a cosine of {cosines:.3g} between two axes); resample it onto "
            "axes at right angles (nearest neighbour)",
        )


def _whole_numbers(path: Path, values: NDArray[Any]) -> NDArray[np.int32]:
    if values.dtype.kind not in "buif":
        raise FileFormatError(path, f"has values of type {values.dtype}; labels are whole numbers")
    low, high = float(values.min()), float(values.max())
    is_whole = math.isfinite(low + high) and (
        values.dtype.kind != "f" or bool((values == np.rint(values)).all())
    )
    if not is_whole or low < 0 or high > np.iinfo(np.int32).max:
        raise FileFormatError(
            path,
            f"has values from {low:g} to {high:g} that are not all whole numbers from 0 on: it is "
            "an image, or a map of probabilities; segment it first",
        )
    return values.astype(np.int32)
