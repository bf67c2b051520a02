"""What a phantom is, in numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.phantom.breast import BreastPhantom, Lesion
from mammosim.phantom.label_counts import label_counts
from mammosim.phantom.lesion_kinds import lesion_tissues
from mammosim.phantom.open_end import abdominal_counts
from mammosim.phantom.place import tissue_box_mm
from mammosim.tissues import TISSUES

FIBROGLANDULAR = ("gland", "tdlu", "duct")
"""What counts to the density; septa and vessels, which lie in fat as well, are reported beside."""

NOT_WITHIN_SKIN = ("air", "skin", "nipple", "muscle", *lesion_tissues())


@dataclass(frozen=True, eq=False)
class PhantomSummary:
    """Size, volumes and contents of a phantom.

    Parameters
    ----------
    source : str
    orientation : str
        How the file's axes were taken to lie, in words; empty for a generated breast.
    shape : tuple of int
        Voxels along x, y, z.
    voxel_mm : tuple of float
    extent_mm : tuple of (float, float)
        Outer faces of the box around all tissue along x, y, z, breast frame, mm.
    laterality : {"L", "R"}
    volume_ml : dict of str to float
        Volume of each tissue that occurs, mL; of mixtures, each tissue's part.
    breast_ml : float
        All tissue but muscle and, in a generated breast, the abdominal wall below the inframammary
        fold, mL.
    fibroglandular_percent : float or None
        Share of gland, ducts and terminal units in the volume within the skin, without muscle,
        lesions and abdominal wall, %. Septa are in `volume_ml` as ligament.
    nipple_mm : tuple of float
    lesions : tuple of Lesion
    notes : tuple of str
    """

    source: str
    orientation: str
    shape: tuple[int, ...]
    voxel_mm: tuple[float, ...]
    extent_mm: tuple[tuple[float, float], ...]
    laterality: str
    volume_ml: dict[str, float]
    breast_ml: float
    fibroglandular_percent: float | None
    nipple_mm: tuple[float, ...]
    lesions: tuple[Lesion, ...]
    notes: tuple[str, ...]


def phantom_summary(breast: BreastPhantom) -> PhantomSummary:
    """Summarise a phantom.

    Parameters
    ----------
    breast : BreastPhantom

    Returns
    -------
    PhantomSummary
    """
    counts = label_counts(breast).sum(axis=0)
    own = _volumes_ml(breast, counts - abdominal_counts(breast))
    within = {tissue: ml for tissue, ml in own.items() if tissue not in NOT_WITHIN_SKIN}
    total = sum(within.values())
    share = 100.0 * sum(within.get(name, 0.0) for name in FIBROGLANDULAR) / total if total else None
    box = tissue_box_mm(breast)
    return PhantomSummary(
        source=breast.source,
        orientation=breast.orientation,
        shape=breast.labels.shape,
        voxel_mm=tuple(breast.voxel_mm.tolist()),
        extent_mm=tuple((float(a), float(b)) for a, b in box.T),
        laterality=breast.laterality,
        volume_ml=_volumes_ml(breast, counts),
        breast_ml=sum(own.values()) - own.get("muscle", 0.0),
        fibroglandular_percent=share,
        nipple_mm=tuple(breast.nipple_mm.tolist()),
        lesions=breast.lesions,
        notes=breast.notes,
    )


def _volumes_ml(breast: BreastPhantom, counts: NDArray[np.int64]) -> dict[str, float]:
    """Volume of each tissue in so many voxels of each label, mL."""
    voxel_ml = float(np.prod(breast.voxel_mm)) / 1000.0
    volume: dict[str, float] = {}
    for label in np.flatnonzero(counts):
        tissue = breast.tissue_of_label[int(label)]
        for part, share_of_voxel in (TISSUES[tissue].mixture or {tissue: 1.0}).items():
            if part != "air":
                found_ml = int(counts[label]) * voxel_ml * share_of_voxel
                volume[part] = volume.get(part, 0.0) + found_ml
    return volume
