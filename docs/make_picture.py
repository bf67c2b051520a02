"""Make the picture of README from a run of the quickstart configuration.

python docs/make_picture.py runs/quickstart docs/images/quickstart.png
"""

from __future__ import annotations

import sys
from pathlib import Path

from PIL import Image

HEIGHT_PX, WIDTH_PX = 900, 560


def main() -> None:
    """Put the two previews side by side, without the air beyond the nipple."""
    run, target = map(Path, sys.argv[1:])
    sheet = Image.new("L", (2 * WIDTH_PX + 8, HEIGHT_PX), 40)
    for number, view in enumerate(("LCC", "LMLO")):
        picture = Image.open(run / view / "preview.png").convert("L")
        scale = HEIGHT_PX / picture.height
        small = picture.resize((round(picture.width * scale), HEIGHT_PX), Image.Resampling.LANCZOS)
        sheet.paste(small.crop((0, 0, WIDTH_PX, HEIGHT_PX)), (number * (WIDTH_PX + 8), 0))
    sheet.save(target, optimize=True)


if __name__ == "__main__":
    main()
