"""Make the pictures of generated breasts in docs/explanation/phantom.md, two a density class.

python docs/make_breasts.py docs/images/phantom
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

import mammosim

BREASTS = {"fatty": (1, 3), "scattered": (102, 104), "heterogeneous": (201, 203),
           "dense": (301, 303)}  # fmt: skip
"""Seeds of each class."""

VOXEL_MM, PIXEL_MM = 0.4, 0.2
COMPRESSION = {"model": "hyperelastic", "resolution_mm": 4.0, "chest_wall": "sliding",
               "stiffness": "aspiration"}  # fmt: skip
EDGE_MM, ROUNDING_MM = {"CC": 15.0, "MLO": 5.0}, 3.0
"""Of the plates in front of the chest wall, as in configs/cohort.yaml; the detector begins where
their edge's rounding has ended."""

HEIGHT_PX, WIDTH_PX = 330, 210


def main() -> None:
    """One sheet a class: CC and MLO of two breasts."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for density, seeds in BREASTS.items():
        sheet = Image.new("L", (4 * WIDTH_PX + 12, HEIGHT_PX), 40)
        place = 0
        for seed in seeds:
            breast = mammosim.generate_phantom(density, VOXEL_MM, seed)
            for view in ("CC", "MLO"):
                sheet.paste(picture(breast, view), (place, 0))
                place += WIDTH_PX + 4
        sheet.save(folder / f"{density}.png", optimize=True)


def picture(breast: mammosim.BreastPhantom, view: str) -> Image.Image:
    """A view for presentation, without the air beyond the nipple."""
    edge = EDGE_MM[view]
    compressed = mammosim.compress(breast, view=view, plate_edge_mm=edge, **COMPRESSION)
    paths = mammosim.project(compressed, pixel_mm=PIXEL_MM, detector_edge_mm=edge + ROUNDING_MM)
    image = mammosim.expose(paths, seed=1)
    grey = image.for_presentation.astype(float) * (255.0 / 4095.0)
    whole = Image.fromarray(np.clip(grey, 0.0, 255.0).astype(np.uint8))
    width = round(whole.width * HEIGHT_PX / whole.height)
    small = whole.resize((width, HEIGHT_PX), Image.Resampling.LANCZOS)
    return small.crop((0, 0, WIDTH_PX, HEIGHT_PX))


if __name__ == "__main__":
    main()
