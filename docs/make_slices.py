"""A mammogram, the synthetic one and slices of one compression: the picture of tomosynthesis.md.

python docs/make_slices.py docs/images/tomosynthesis-slices.png
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

import mammosim

THICKNESS_MM, SLICES = 40.0, 5
HEIGHT_PX, GAP, TITLE_PX = 430, 4, 20
"""Height of each panel, space between two, and space for its title."""

SHOWN_MM = (130.0, 62.0)
"""Part of each image that is shown, along the chest wall and from its edge, mm."""

ARC: dict[str, Any] = {
    "view": "CC", "angle_range_deg": 50, "projections": 25,
    "reconstruct": {"method": "sart", "iterations": 1, "slice_mm": 1, "synthetic_2d": True},
}  # fmt: skip

VIEWS: list[Any] = ["CC", {"dbt": ARC}]


def main() -> None:
    """Simulate both views, and put mammogram, synthetic mammogram and slices beside each other."""
    common: dict[str, Any] = {
        "phantom": {
            "generate": {"density": "scattered", "volume_ml": 450, "voxel_mm": 0.3},
            "lesions": [{"name": "cluster", "kind": "calcification", "diameter_mm": 8}],
        },
        "compression": {
            "model": "hyperelastic", "stiffness": "aspiration", "chest_wall": "fascia",
            "resolution_mm": 4.0, "plate_edge_mm": 15, "thickness_mm": THICKNESS_MM,
        },
        "projection": {"pixel_mm": 0.15, "detector_edge_mm": 20},
        "seed": 4,
    }  # fmt: skip
    study = mammosim.simulate(**common, views=VIEWS)
    flat, series = study.views["LCC"], study.views["LCC_DBT"]
    assert flat.mammogram is not None
    assert series.reconstruction is not None
    volume = series.reconstruction
    assert volume.synthetic is not None
    (cluster,) = (target for target in series.targets if target.name == "cluster")
    heights = np.linspace(0.15, 0.85, SLICES) * THICKNESS_MM
    heights[np.argmin(np.abs(heights - cluster.compressed_z_mm))] = cluster.compressed_z_mm
    numbers = np.rint(heights / volume.grid.slice_mm - 0.5).astype(int)
    low, high = volume.shown_range
    panels = [
        panel("mammogram", flat.mammogram.for_presentation / 4095.0, 0.15),
        panel("synthetic, ours", volume.synthetic.pixels / 4095.0, volume.grid.pixel_mm),
        *(
            panel(
                f"{(number + 0.5) * volume.grid.slice_mm:g} mm",
                (volume.slices[number] - low) / (high - low),
                volume.grid.pixel_mm,
            )
            for number in numbers
        ),
    ]
    width = panels[0].width + GAP
    sheet = Image.new("L", (len(panels) * width - GAP, panels[0].height))
    for number, one in enumerate(panels):
        sheet.paste(one, (number * width, 0))
    sheet.save(sys.argv[1], optimize=True)


def panel(title: str, grey: NDArray[Any], pixel_mm: float) -> Image.Image:
    """An image with its chest wall on the left and the breast in the middle, under its title."""
    height, width = (round(side / pixel_mm) for side in SHOWN_MM)
    grey = np.clip(grey, 0.0, 1.0)
    rows = np.flatnonzero((grey[:, : width // 2] > 0.05).mean(axis=1) > 0.3)
    first = (rows[0] + rows[-1] - height) // 2
    shown = np.zeros((height, width))
    part = grey[max(first, 0) : first + height, :width]
    start = max(-first, 0)
    shown[start : start + part.shape[0], : part.shape[1]] = part
    scale = HEIGHT_PX / height
    image = Image.fromarray((255.0 * shown).astype(np.uint8)).resize(
        (round(width * scale), HEIGHT_PX), Image.Resampling.LANCZOS
    )
    titled = Image.new("L", (image.width, HEIGHT_PX + TITLE_PX))
    titled.paste(image, (0, TITLE_PX))
    ImageDraw.Draw(titled).text((2, 4), title, fill=255)
    return titled


if __name__ == "__main__":
    main()
