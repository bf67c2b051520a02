"""Crops of every kind of lesion in one generated breast: the picture in explanation/phantom.md.

python docs/make_lesions.py docs/images/phantom/lesions.png
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import mammosim

CROP_MM, CROP_PX, GAP, COLUMNS = 24.0, 240, 4, 4
"""Each crop's edge, on the breast and in the picture; the space between two; crops in a row."""

LESIONS: list[dict[str, Any]] = [
    {"name": "spiculated", "kind": "mass", "margin": "spiculated", "diameter_mm": 10},
    {"name": "distortion", "kind": "mass", "margin": "distortion", "diameter_mm": 16},
    {"name": "lobulated", "kind": "mass", "margin": "lobulated", "diameter_mm": 10},
    {"name": "pleomorphic", "kind": "calcification", "morphology": "pleomorphic"},
    {"name": "linear", "kind": "calcification", "morphology": "linear"},
    {"name": "vascular", "kind": "calcification", "morphology": "vascular"},
    {"name": "clip", "kind": "clip"},
]  # fmt: skip


def main() -> None:
    """Simulate the breast, and put the crops beside each other."""
    phantom: Any = {
        "generate": {"density": "fatty", "volume_ml": 700, "voxel_mm": 0.2},
        "lesions": LESIONS,
    }
    study = mammosim.simulate(
        phantom=phantom,
        compression={
            "model": "hyperelastic", "stiffness": "aspiration", "chest_wall": "fascia",
            "resolution_mm": 4.0, "plate_edge_mm": 15,
        },
        projection={"detector_edge_mm": 20},
        views=["CC"],
        seed=11,
    )  # fmt: skip
    view = study.views["LCC"]
    assert view.mammogram is not None
    image, pixel_mm = view.mammogram.for_presentation, view.mammogram.gantry.pixel_mm
    pixel_mm /= view.mammogram.gantry.magnification
    shown = [target for target in view.targets if target.is_lesion]
    rows = -(-len(shown) // COLUMNS)
    step = CROP_PX + GAP
    sheet = Image.new("L", (COLUMNS * step - GAP, rows * step - GAP), 60)
    for number, target in enumerate(shown):
        crop = cut(image, target.image_row_px, target.image_col_px, CROP_MM / pixel_mm)
        place = (number % COLUMNS * step, number // COLUMNS * step)
        sheet.paste(crop.resize((CROP_PX, CROP_PX), Image.Resampling.LANCZOS), place)
    sheet.save(sys.argv[1], optimize=True)


def cut(image: NDArray[Any], row: float, column: float, width_px: float) -> Image.Image:
    """A square around a pixel, moved inwards at the image's edge, from its darkest to brightest."""
    width = round(width_px)
    first = [
        int(np.clip(round(middle - 0.5 * width), 0, count - width))
        for middle, count in zip((row, column), image.shape, strict=True)
    ]
    part = image[first[0] : first[0] + width, first[1] : first[1] + width].astype(float)
    low, high = np.percentile(part, [1.0, 99.5])
    return Image.fromarray(
        (255.0 * np.clip((part - low) / (high - low), 0.0, 1.0)).astype(np.uint8)
    )


if __name__ == "__main__":
    main()
