"""Kit of a blind reading: single PNG images of equal size, names hidden, and the answers apart.

    python benchmarks/blind_reading.py --real FOLDER --simulated FOLDER --output FOLDER [--seed N]

Takes real mammograms (DICOM or pictures) and simulated ones (`for_presentation.dcm`, also in
subfolders), draws six of each and writes `image_01.png` to `image_12.png`: half of them whole
pictures, half crops of 40 mm, the same number of each kind from both sides. All are grey, 8 bits,
chest wall at the left, without metadata. `<output>_answers.csv` is written beside the folder, not
into it, and says which is which. `form.csv` is what a reader fills in.

Labels burnt into real pictures would give them away: everything outside the breast is set to
black, in simulated ones too. A marker on the nipple is not removed: choose pictures without one.
No picture of others may be committed.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

SIZE_PX = 900  # side of each PNG
CROP_MM = 40.0
CROP_DEPTHS_MM = (0.0, 25.0)  # a crop's centre is this deep at least: at the skin, and well inside
AROUND_MM = 6.0
SUFFIXES = (".dcm", ".png", ".tif", ".tiff", ".pgm", ".jpg")
Grey = NDArray[np.float64]


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--real", type=Path, required=True, help="folder of real mammograms")
    parser.add_argument("--simulated", type=Path, required=True, help="folder of simulated ones")
    parser.add_argument("--output", type=Path, required=True, help="folder to write, new or empty")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--images", type=int, default=12, help="how many in all, even")
    parser.add_argument(
        "--pixel-mm", type=float, default=0.1, help="pitch of pictures that do not say theirs"
    )
    asked = parser.parse_args()
    write_kit(asked.real, asked.simulated, asked.output, asked.seed, asked.images, asked.pixel_mm)


def write_kit(
    real: Path, simulated: Path, output: Path, seed: int, images: int = 12, pixel_mm: float = 0.1
) -> None:
    """Draw, hide and write."""
    if output.exists() and any(output.iterdir()):
        raise SystemExit(f"{output} is not empty")
    rng = np.random.default_rng(seed)
    drawn = []
    for kind, folder in (("real", real), ("simulated", simulated)):
        files = pictures(folder, kind)
        if not files:
            raise SystemExit(f"{folder}: found no mammogram, expected {', '.join(SUFFIXES)}")
        order = [files[i] for i in rng.permutation(len(files))]
        for number in range(images // 2):
            drawn.append((kind, order[number % len(order)], "whole" if number % 2 else "crop"))
    output.mkdir(parents=True, exist_ok=True)
    answers = []
    for place, choice in enumerate(rng.permutation(len(drawn)), start=1):
        kind, file, view = drawn[choice]
        grey, pitch = load(file, pixel_mm)
        grey, breast = alone(grey, pitch)
        shown = crop(grey, breast, pitch, rng) if view == "crop" else whole(grey, breast, pitch)
        name = f"image_{place:02d}.png"
        Image.fromarray(np.rint(255.0 * shown).astype(np.uint8)).save(output / name)
        answers.append((name, kind, view, str(file)))
    _write(output.with_name(output.name + "_answers.csv"), ("image", "is", "part", "file"), answers)
    form = [(name, "", "", "") for name, *_ in answers]
    _write(output / "form.csv", ("image", "real or simulated", "how sure, %", "why"), form)
    print(f"{len(answers)} images in {output}; answers in {output.name}_answers.csv beside it")


def pictures(folder: Path, kind: str) -> list[Path]:
    """Files of a folder; of simulated ones only those for presentation."""
    if kind == "simulated":
        return sorted(folder.rglob("for_presentation.dcm"))
    return sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES)


def load(file: Path, pixel_mm: float) -> tuple[Grey, float]:
    """Grey as displayed, 0 to 1, and pixel pitch, mm."""
    if file.suffix.lower() == ".dcm":
        import pydicom
        from pydicom.pixels import apply_voi_lut

        data = pydicom.dcmread(file)
        values = apply_voi_lut(data.pixel_array, data).astype(float)
        low, high = float(values.min()), float(values.max())
        grey = (values - low) / max(high - low, 1.0)
        if data.PhotometricInterpretation == "MONOCHROME1":
            grey = 1.0 - grey
        pitch = data.get("ImagerPixelSpacing") or data.get("PixelSpacing") or [pixel_mm]
        return grey, float(pitch[0])
    values = np.asarray(Image.open(file)).astype(float)
    values = values[..., :3].mean(axis=2) if values.ndim == 3 else values
    top = 255.0 if values.max() <= 255 else 4095.0 if values.max() <= 4095 else 65535.0
    return values / top, pixel_mm


def alone(grey: Grey, pixel_mm: float) -> tuple[Grey, NDArray[np.bool_]]:
    """The breast alone, chest wall at the left, all else black, cut to its surroundings."""
    smooth = ndimage.gaussian_filter(grey, 0.3 / pixel_mm)
    opened = ndimage.binary_opening(
        smooth > float(np.quantile(grey, 0.02)) + 0.03, iterations=round(1.0 / pixel_mm)
    )
    labels, count = ndimage.label(opened)
    if count == 0:
        raise SystemExit("found no breast in a picture")
    breast = ndimage.binary_fill_holes(labels == 1 + np.argmax(np.bincount(labels.ravel())[1:]))
    half = breast.shape[1] // 2
    if breast[:, :half].sum() < breast[:, half:].sum():
        grey, breast = grey[:, ::-1], breast[:, ::-1]
    reach = round(AROUND_MM / pixel_mm)
    near = ndimage.distance_transform_edt(~breast) <= round(2.0 / pixel_mm)
    grey = np.where(near, grey, 0.0)
    rows, columns = (np.flatnonzero(breast.any(axis=axis)) for axis in (1, 0))
    part = np.s_[max(0, rows[0] - reach) : rows[-1] + reach, columns[0] : columns[-1] + reach]
    return grey[part], breast[part]


def whole(grey: Grey, breast: NDArray[np.bool_], pixel_mm: float) -> Grey:
    """The whole breast in a square, black around it."""
    side = max(grey.shape)
    square = np.zeros((side, side))
    top = (side - grey.shape[0]) // 2
    square[top : top + grey.shape[0], : grey.shape[1]] = grey
    return resized(square)


def crop(grey: Grey, breast: NDArray[np.bool_], pixel_mm: float, rng: np.random.Generator) -> Grey:
    """A square of `CROP_MM` with its centre at a random place of the breast."""
    side = min(round(CROP_MM / pixel_mm), *grey.shape)
    depth = ndimage.distance_transform_edt(np.pad(breast, 1, mode="edge"))[1:-1, 1:-1] * pixel_mm
    places = np.argwhere(depth > min(rng.choice(CROP_DEPTHS_MM), 0.7 * depth.max()))
    row, column = places[rng.integers(len(places))]
    top, left = (
        int(np.clip(at - side // 2, 0, size - side))
        for at, size in zip((row, column), grey.shape, strict=True)
    )
    return resized(grey[top : top + side, left : left + side])


def resized(grey: Grey) -> Grey:
    """To the size of all images."""
    picture = Image.fromarray(grey.astype(np.float32))
    filtered = picture.resize((SIZE_PX, SIZE_PX), Image.Resampling.LANCZOS)
    return np.clip(np.asarray(filtered, dtype=np.float64), 0.0, 1.0)


def _write(file: Path, head: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(head)
        writer.writerows(rows)


if __name__ == "__main__":
    main()
