"""Make the images of docs/gallery.md from the configurations on that page.

python docs/make_gallery.py docs/gallery.md docs/images/gallery [SECTION ...]
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from PIL import Image

import mammosim
from mammosim.pipeline import Study, ViewResult

CASE = re.compile(r"^## ([^\n]+)\n.*?^```yaml\n(.*?)^```$", re.DOTALL | re.MULTILINE)
"""A heading, and the configuration below it."""

PX_PER_MM = 1.8
"""Pixels of the gallery for each mm on the detector."""

IODINE_MG_CM2 = (-1.0, 2.0)
"""Shown from black to white in a recombined image."""

MARGIN_MM = 8.0
"""Air that is kept beside the breast."""


def main() -> None:
    """One PNG file for each case, or for those that are named."""
    page, folder, *wanted = sys.argv[1:]
    for title, text in CASE.findall(Path(page).read_text(encoding="utf-8")):
        name = re.sub(r"[^a-z]+", "-", title.lower())
        if wanted and name not in wanted:
            continue
        with TemporaryDirectory() as place:
            path = Path(place) / "case.yaml"
            path.write_text(text, encoding="utf-8")
            study = mammosim.simulate(mammosim.load_config(path))
        shown = [image for view in study.views.values() for image in images_of(study, view)]
        side_by_side(shown).save(Path(folder) / f"{name}.png", optimize=True)


def images_of(study: Study, view: ViewResult) -> list[Image.Image]:
    """What the gallery shows of a view."""
    if view.reconstruction is not None:
        return _slice_and_synthetic(study, view)
    mammogram = view.mammogram
    assert mammogram is not None
    low = mammogram.window_center - 0.5 * mammogram.window_width
    grey = (mammogram.for_presentation - low) / mammogram.window_width
    inside = mammogram.for_presentation > 0
    shown = [framed(grey, inside, mammogram.gantry.pixel_mm)]
    if mammogram.contrast is not None:
        black, white = IODINE_MG_CM2
        iodine = (mammogram.contrast.iodine.flattened_mg_cm2 - black) / (white - black)
        shown.append(framed(iodine, inside, mammogram.gantry.pixel_mm))
    return shown


def _slice_and_synthetic(study: Study, view: ViewResult) -> list[Image.Image]:
    volume = view.reconstruction
    assert volume is not None
    assert volume.synthetic is not None
    low, high = volume.shown_range
    mass = next(target for target in study.targets if target.is_lesion)
    slice_ = volume.slices[round(mass.volume_slice)]
    inside = volume.synthetic.pixels > 0
    return [
        framed((slice_ - low) / (high - low), inside, volume.grid.pixel_mm),
        framed(volume.synthetic.pixels / 4095.0, inside, volume.grid.pixel_mm),
    ]


def framed(grey: NDArray[np.floating], inside: NDArray[np.bool_], pixel_mm: float) -> Image.Image:
    """An image, 0 black and 1 white, cropped to the breast and scaled."""
    margin = round(MARGIN_MM / pixel_mm)
    sides = []
    for axis in (0, 1):
        found = np.flatnonzero(inside.any(axis=1 - axis))
        sides.append(slice(max(found[0] - margin, 0), found[-1] + 1 + margin))
    cropped = np.clip(255.0 * grey[tuple(sides)], 0.0, 255.0).astype(np.uint8)
    whole = Image.fromarray(cropped)
    scale = PX_PER_MM * pixel_mm
    size = (round(whole.width * scale), round(whole.height * scale))
    return whole.resize(size, Image.Resampling.LANCZOS)


def side_by_side(shown: list[Image.Image]) -> Image.Image:
    """The images in a row, on black."""
    width = sum(image.width for image in shown) + 8 * (len(shown) - 1)
    sheet = Image.new("L", (width, max(image.height for image in shown)), 0)
    left = 0
    for image in shown:
        sheet.paste(image, (left, (sheet.height - image.height) // 2))
        left += image.width + 8
    return sheet


if __name__ == "__main__":
    main()
