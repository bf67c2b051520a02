"""Files with patient axes by SimpleITK: MHA, NRRD, and NIfTI once its length is checked."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mammosim.errors import InputError
from mammosim.phantom.readers.volume import (
    Volume,
    checked_origin,
    checked_spacing,
    from_patient_axes,
)


def read_itk(path: Path) -> Volume:
    """Read a volume that SimpleITK knows.

    Parameters
    ----------
    path : path
        A file with patient axes (LPS inside SimpleITK, whatever the format's own).

    Raises
    ------
    InputError
        If the file cannot be read, is not one scalar volume, or its axes are oblique.
    """
    import SimpleITK as sitk

    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    try:
        reader.ReadImageInformation()
        sides = [side for side in reader.GetSize() if side != 1]
        if len(sides) != 3 or reader.GetNumberOfComponents() != 1:
            raise InputError(
                f"{path}: found size {list(reader.GetSize())} with "
                f"{reader.GetNumberOfComponents()} values a voxel, expected one volume of labels"
            )
        spacing = checked_spacing(reader.GetSpacing()[:3], path)
        image = reader.Execute()
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1].strip()
        raise InputError(
            f"{path}: cannot be read, truncated or not its format ({reason})"
        ) from None
    values = sitk.GetArrayFromImage(image).reshape(image.GetSize()[2::-1])
    dimension = image.GetDimension()
    direction = np.array(image.GetDirection()).reshape(dimension, dimension)[:3, :3]
    origin = checked_origin(image.GetOrigin()[:3], path)
    return from_patient_axes(values.transpose(2, 1, 0), spacing, origin, direction, path)
