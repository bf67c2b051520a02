"""Contrast and signal difference to noise of a lesion, against pictures with and without it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from naive.projection import phantom, unsqueezed

from mammosim.acquisition import expose, lesion_visibility
from mammosim.phantom import Lesion
from mammosim.projection import project

LESION = 160
TECHNIQUE = {"target": "W", "filter": "Rh", "kvp": 28, "mas": 90}


def slab(tissue_in_ball, voxel_mm=1.0):
    """40 x 60 x 40 mm of fat with a ball of 10 mm in the middle; the ball may be fat itself."""
    shape = np.array([40, 60, 40])
    at = np.stack(np.indices(shape), axis=-1) - 0.5 * (shape - 1)
    labels = np.ones(shape, np.uint8)
    inside = np.linalg.norm(at, axis=-1) <= 5.0
    labels[inside] = LESION
    ball = Lesion("m", "mass", LESION, tissue_in_ball, np.zeros(3), float(inside.sum()))
    return phantom(labels, voxel_mm, [0.5, -29.5, -19.5], lesions=(ball,))


def views(tissue, **keys):
    breast = slab(tissue)
    paths = project(unsqueezed(breast), pixel_mm=0.2, detector_mm=[80.0, 50.0])
    image = expose(paths, seed=4, **TECHNIQUE, **keys)
    return breast, paths, image


def core(paths):
    length = paths.length_mm[paths.lesion_labels.index(LESION)]
    return length >= 0.5 * length.max()


def test_the_contrast_is_that_between_pictures_with_and_without_the_lesion():
    quiet = {"noise": False}
    breast, paths, with_it = views("mass", **quiet)
    _, _, without = views("adipose", **quiet)
    seen = lesion_visibility(breast, paths, with_it, **TECHNIQUE, **quiet)[LESION]
    one, other = (image.for_processing[core(paths)].astype(float) for image in (with_it, without))
    contrast = (other.sum() - one.sum()) / other.sum()
    assert 0.05 < contrast < 0.5
    # The lesion's own scatter and blur out of its core are left out: a few per cent of it.
    assert seen.contrast == pytest.approx(contrast, rel=0.05)


def test_the_noise_is_that_of_the_recorded_picture():
    breast, paths, image = views("mass")
    seen = lesion_visibility(breast, paths, image, **TECHNIQUE)[LESION]
    still = expose(paths, **TECHNIQUE, noise=False).for_processing[core(paths)].astype(float)
    difference = still.mean() * seen.contrast / (1.0 - seen.contrast)
    deviation = np.std(image.for_processing[core(paths)] - still)
    # About 1700 pixels: 1.7 % of statistics, two deviations of it, and rounding of counts.
    assert seen.sdnr == pytest.approx(difference / deviation, rel=0.05)


def test_dose_goes_with_the_square_of_sdnr_and_leaves_contrast():
    breast, paths, image = views("mass")
    dim = expose(paths, seed=4, **{**TECHNIQUE, "mas": 22.5})
    one = lesion_visibility(breast, paths, image, **TECHNIQUE)[LESION]
    quarter = lesion_visibility(breast, paths, dim, **{**TECHNIQUE, "mas": 22.5})[LESION]
    # Pixel values are noisy: half a per cent over the core.
    assert quarter.contrast == pytest.approx(one.contrast, rel=0.02)
    # Electronic noise weighs more at the lower dose, the fixed pattern (0.2 % of the signal beside
    # about 0.7 % of quantum noise) at the higher one.
    assert 0.45 < quarter.sdnr / one.sdnr < 0.55


def test_what_is_like_its_surroundings_is_not_seen_and_what_has_no_shadow_is_left_out():
    breast, paths, image = views("adipose")
    seen = lesion_visibility(breast, paths, image, **TECHNIQUE)[LESION]
    assert seen.contrast == pytest.approx(0.0, abs=1e-9)
    assert seen.sdnr == pytest.approx(0.0, abs=1e-9)
    paths.length_mm[paths.lesion_labels.index(LESION)] = 0.0
    assert lesion_visibility(breast, paths, image, **TECHNIQUE) == {}
    gone = dataclasses.replace(paths, lesion_labels=(0,) * len(paths.tissues))
    assert lesion_visibility(breast, gone, image, **TECHNIQUE) == {}
