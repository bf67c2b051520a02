"""The uncompressed breast of a run, beside its tables."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np

from mammosim.export.label_files import table_of_phantom, write_label_files
from mammosim.export.viewer_files import write_viewer_files
from mammosim.export.volumes import write_labels
from mammosim.phantom import BreastPhantom

UNCOMPRESSED_FILE = "uncompressed.nii.gz"


def write_phantom(
    breast: BreastPhantom, folder: str | PathLike[str], viewers: bool = False
) -> None:
    """Write the uncompressed breast, and what its labels stand for.

    Parameters
    ----------
    breast : BreastPhantom
        With the lesions that were put in.
    folder : path
        Gets ``uncompressed.nii.gz``, ``labels.json`` and ``labels.ctbl``.
    viewers : bool
        Whether to write the files of `write_viewer_files` too.

    Raises
    ------
    InputError
        If a file cannot be written.

    Notes
    -----
    The file is in patient space as the volumes of each view are, so that `displacement.nii.gz`
    resamples a view's `compressed.nii.gz` onto it.
    """
    folder = Path(folder)
    write_labels(breast.labels, breast.frame, np.eye(3), folder / UNCOMPRESSED_FILE)
    table = table_of_phantom(breast)
    write_label_files(table, (UNCOMPRESSED_FILE,), folder)
    if viewers:
        write_viewer_files(table, breast.labels, breast.frame, np.eye(3), folder, "uncompressed")
