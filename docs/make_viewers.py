"""Draws what 3D Slicer is given of a run: segments in their colours, and the markups.

    python docs/make_viewers.py RUN docs/images/viewers.png

RUN is the folder of a run with `export: {viewers: true}` and a view LCC.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import SimpleITK as sitk
from matplotlib.patches import Patch


def draw(axes, segments: Path, markups: Path, title: str) -> dict[str, tuple[float, ...]]:
    """The sagittal slice through the first lesion; gives the colours of the segments in it."""
    volume = sitk.ReadImage(str(segments))
    points = json.loads(markups.read_text(encoding="utf-8"))["markups"][0]["controlPoints"]
    places = [volume.TransformPhysicalPointToContinuousIndex(p["position"]) for p in points]
    keys = [key for key in volume.GetMetaDataKeys() if key.endswith("_LabelValue")]
    about = {int(volume.GetMetaData(key)): key.removesuffix("LabelValue") for key in keys}
    labels = sitk.GetArrayFromImage(volume)
    across = int(np.argmax(np.abs(np.array(volume.GetDirection()).reshape(3, 3)[0])))
    cut = np.take(labels, round(places[0][across]), axis=2 - across)
    shown, named = np.ones((*cut.shape, 3)), {}
    for value in np.unique(cut[cut > 0]):
        colour = tuple(float(c) for c in volume.GetMetaData(f"{about[value]}Color").split())
        shown[cut == value] = named[volume.GetMetaData(f"{about[value]}Name")] = colour
    axes.imshow(shown, origin="lower")
    down, along = (axis for axis in (2, 1, 0) if axis != across)
    for point, place in zip(points, places, strict=True):
        axes.plot(place[along], place[down], "kx", markersize=5)
        axes.annotate(point["label"], (place[along], place[down]), fontsize=7)
    axes.set(title=title, xticks=[], yticks=[])
    return named


def main(run: Path, target: Path) -> None:
    """Uncompressed and compressed, side by side."""
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 4.6), layout="constrained")
    folders = (("uncompressed", run), ("compressed", run / "LCC"))
    named: dict[str, tuple[float, ...]] = {}
    for one, (name, folder) in zip(axes, folders, strict=True):
        named |= draw(one, folder / f"{name}.seg.nrrd", folder / "lesions.mrk.json", name)
    patches = [Patch(color=colour, label=name) for name, colour in named.items()]
    figure.legend(handles=patches, loc="outside lower center", ncols=5, frameon=False)
    figure.savefig(target, dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
