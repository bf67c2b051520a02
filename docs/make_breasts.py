"""CC and MLO of several runs side by side: the picture of the classes in explanation/phantom.md.

    python docs/make_breasts.py docs/images/phantom/classes.png RUN_FOLDER...

Each run has a left CC and MLO as in explanation/pictures.md; the page shows seeds 7209 to 7212.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pydicom
from PIL import Image

SHOWN_MM, PIXELS_PER_MM = (88.0, 165.0), 2.5
"""Width and height shown of each image, from its upper edge and chest wall, and their scale."""

GAP = 4


def main() -> None:
    """Read the command line."""
    output, *runs = (Path(word) for word in sys.argv[1:])
    width, height = (round(PIXELS_PER_MM * side) for side in SHOWN_MM)
    sheet = Image.new("L", (len(runs) * (width + GAP) - GAP, 2 * height + GAP), 60)
    for column, run in enumerate(runs):
        for row, view in enumerate(("LCC", "LMLO")):
            shown = picture(run / view / "for_presentation.dcm").resize(
                (width, height), Image.Resampling.LANCZOS
            )
            sheet.paste(shown, (column * (width + GAP), row * (height + GAP)))
    sheet.save(output, optimize=True)


def picture(path: Path) -> Image.Image:
    """The part of an image with the breast, centred on it from top to bottom in CC."""
    image = pydicom.dcmread(path)
    pixel = float(image.ImagerPixelSpacing[0])
    grey = image.pixel_array.astype(float) / (2**image.BitsStored - 1)
    width, height = (round(side / pixel) for side in SHOWN_MM)
    rows = np.flatnonzero((grey > 0.03).any(axis=1))
    first = max(0, (rows[0] + rows[-1] - height) // 2) if rows[0] > 0 else 0
    cut = grey[first : first + height, :width]
    whole = np.zeros((height, width))
    whole[: cut.shape[0], : cut.shape[1]] = cut
    return Image.fromarray((255.0 * whole).astype(np.uint8))


if __name__ == "__main__":
    main()
