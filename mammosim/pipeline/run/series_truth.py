"""Where lesions are in each projection of a series, noted while the projections are traced."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition import Tomosynthesis
from mammosim.compression import CompressedBreast
from mammosim.export import label_image, lesion_masks
from mammosim.pipeline.study import ViewResult
from mammosim.projection import PathLengths
from mammosim.reconstruction import Reconstruction
from mammosim.targets import Target, find_targets, in_volume


class SeriesTruth:
    """What is known of the lesions in a series of projections.

    Path lengths of all projections would not fit in memory; only those of the middle one are kept.

    Parameters
    ----------
    compressed : CompressedBreast
    first_id : int
        Number of the breast's first target in the run.
    """

    def __init__(self, compressed: CompressedBreast, first_id: int = 1) -> None:
        self._compressed, self._first_id = compressed, first_id
        self._middle: PathLengths | None = None
        self._targets: tuple[Target, ...] = ()
        self._images: dict[int, NDArray[np.unsignedinteger]] = {}

    def gather(self, index: int, paths: PathLengths) -> None:
        """Note one projection; `expose_arc` passes the middle one first."""
        if self._middle is None:
            self._middle = paths
            self._targets = tuple(find_targets(self._compressed, paths, first_id=self._first_id))
        if any(paths.lesion_labels):
            masks = lesion_masks(paths, self._targets)
            self._images[index] = label_image(masks, (paths.gantry.rows, paths.gantry.columns))

    def result(self, series: Tomosynthesis, slices: Reconstruction | None) -> ViewResult:
        """The view, once all projections have been exposed and slices have been reconstructed."""
        images = tuple(self._images[index] for index in sorted(self._images))
        targets = self._targets
        if slices is not None:
            targets = tuple(in_volume(target, slices.grid) for target in targets)
        return ViewResult(
            self._compressed, self._middle, series.middle, targets, series, images, slices
        )
