"""What tomosynthesis costs, and how well its slices show what was put in.

    python benchmarks/tomosynthesis.py cost [--config configs/quickstart.yaml]
    python benchmarks/tomosynthesis.py quality

`cost`: the configuration's breast in CC, 25 projections over 50 degrees with pixels of 0.1 mm on a
detector just as large as the shadow; slices of 1 mm by FDK and by SART. Phantom and compression are
left out; all code is compiled before. Wall time, processor time of all threads, and peak memory.

`quality`: a slab of 50 mm with a fifth of gland, three clips of 1 mm at known heights and sixteen
calcifications of 0.2 mm in its middle, exposed with the load that exposure control gives one
mammogram of it. For 50 degrees with 25 and 15 degrees with 15 projections, the latter also with a
detector that turns by 4.2 degrees: error of the clips' places, contrast of the calcifications over
noise of single voxels, and the width of the clips' artefact spread function beside that of an
unfiltered sum of shifted projections.
"""

from __future__ import annotations

import argparse
import math
import resource
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim import InputError, compress, expose_arc, load_config, project_arc, reconstruct
from mammosim.acquisition.settings import ScatterSettings
from mammosim.phantom import BreastPhantom, Lesion, make_phantom
from mammosim.projection import ProjectionSettings, TomosynthesisSettings, cast_shadow
from mammosim.reconstruction import Reconstruction
from mammosim.tissues import TISSUES

PIXEL_MM = 0.1
ARCS = ((50.0, 25, 0.0), (15.0, 15, 0.0), (15.0, 15, 4.2))
SLAB_MM, SLAB_VOXEL_MM = (24.0, 36.0, 50.0), 0.2
CLIP_MM, CALCIFICATION_MM = 1.0, 0.2
CLIPS_MM = ((6.1, -10.1, 9.3), (12.1, 0.1, 22.1), (18.1, 10.1, 34.1))
CALCIFICATIONS_Z_MM = 26.1


def main() -> None:
    """Run the benchmark named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("cost", "quality"))
    parser.add_argument("--config", default="configs/quickstart.yaml")
    given = parser.parse_args()
    try:
        cost(given.config) if given.what == "cost" else quality()
    except InputError as error:
        raise SystemExit(str(error)) from None


def cost(config_file: str) -> None:
    """Print time and memory of projections, exposure and reconstruction."""
    config = load_config(config_file)
    (view,) = (one for one in config.resolved_views if one.view == "CC")
    breast = make_phantom(config.phantom, config.laterality, config.seed)
    compressed = compress(breast, view.position(breast.laterality), view.compression)
    movement = TomosynthesisSettings(view="CC")
    projection = view.projection.model_copy(update={"pixel_mm": PIXEL_MM})
    shadow = cast_shadow(compressed, projection, movement)
    size = {"detector_mm": (math.ceil(shadow.height_mm), math.ceil(shadow.width_mm))}

    few = view.acquisition.model_copy(update={"scatter": ScatterSettings(photons=10_000)})
    rough = projection.model_copy(update={**size, "pixel_mm": 2.0})
    coarse = expose_arc(project_arc(compressed, movement, rough), few)
    reconstruct(coarse, method="sart")  # everything is compiled and loaded
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"before: peak {before / 1e6:.2f} GB, for phantom and compression")
    cropped = projection.model_copy(update=size)
    series = timed(
        "projections and exposure",
        lambda: expose_arc(project_arc(compressed, movement, cropped), view.acquisition),
    )
    print(f"  {series.projections.shape} pixels, {series.middle.thickness_mm:.1f} mm thick")
    for label, keys in (
        ("FDK", {"method": "fdk"}),
        ("SART, 1 iteration", {"method": "sart"}),
        ("SART, 2 iterations", {"method": "sart", "iterations": 2}),
    ):
        volume = timed(label, lambda keys=keys: reconstruct(series, **keys))
        print(f"  {volume.slices.shape} voxels")
        del volume


def timed(label: str, work: Callable[[], Any]) -> Any:
    """Do some work and print what it took."""
    start, spent = time.perf_counter(), time.process_time()
    result = work()
    wall, cpu = time.perf_counter() - start, time.process_time() - spent
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(f"{label}: {wall:.1f} s wall, {cpu:.1f} s CPU, peak {peak:.2f} GB", flush=True)
    return result


def slab() -> BreastPhantom:
    """Layers of 8 mm of fat and 2 mm of gland, with clips and calcifications."""
    shape = tuple(round(side / SLAB_VOXEL_MM) for side in SLAB_MM)
    labels = np.full(shape, TISSUES["adipose"].label, np.uint8)
    # Thick enough for the coarse voxels that Monte Carlo follows photons through.
    labels[:, :, np.arange(shape[2]) % 50 < 10] = TISSUES["gland"].label
    voxel_mm = np.full(3, SLAB_VOXEL_MM)
    origin_mm = np.array([0.1, -0.5 * SLAB_MM[1] + 0.1, 0.1])
    lesions = []
    free = [label for label in range(2, 250) if label not in {t.label for t in TISSUES.values()}]
    places = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), -1)
    places = places * voxel_mm + origin_mm
    for number, centre in enumerate(CLIPS_MM):
        inside = np.linalg.norm(places - centre, axis=-1) <= 0.5 * CLIP_MM
        labels[inside] = free[number]
        position = places[inside].mean(axis=0)
        volume = float(np.count_nonzero(inside)) * SLAB_VOXEL_MM**3
        name = f"clip {number + 1}"
        lesions.append(Lesion(name, "clip", free[number], "clip", position, volume, 1.0))
    del places
    fill = math.pi / 6.0 * (CALCIFICATION_MM / SLAB_VOXEL_MM) ** 3
    marked = np.zeros(shape, bool)
    for x in (4.1, 9.1, 14.1, 19.1):
        for y in (-13.1, -5.1, 5.1, 13.1):
            marked[tuple(np.rint((np.array([x, y, CALCIFICATIONS_Z_MM]) - origin_mm)
                                 / voxel_mm).astype(int))] = True  # fmt: skip
    labels[marked] = free[3]
    centre = np.argwhere(marked).mean(axis=0) * voxel_mm + origin_mm
    volume = 16 * fill * SLAB_VOXEL_MM**3
    lesions.append(
        Lesion("specks", "calcification", free[3], "calcification", centre, volume, fill)
    )
    tissue = {block.label: name for name, block in TISSUES.items()}
    tissue |= {lesion.label: lesion.tissue for lesion in lesions}
    tip = origin_mm + (np.array(shape) - 1) * voxel_mm
    return BreastPhantom(labels, voxel_mm, origin_mm, "L", tissue, tip, tuple(lesions))


def quality() -> None:
    """Print how well clips and calcifications are found."""
    breast = slab()
    compressed = compress(breast, model="none")
    for arc, count, turn in ARCS:
        movement = TomosynthesisSettings(
            view="CC", angle_range_deg=arc, projections=count, detector_angle_range_deg=turn
        )
        projection = ProjectionSettings(pixel_mm=PIXEL_MM)
        shadow = cast_shadow(compressed, projection, movement)
        size = (math.ceil(shadow.height_mm) + 2, math.ceil(shadow.width_mm) + 2)
        projection = projection.model_copy(update={"detector_mm": size})
        series = expose_arc(project_arc(compressed, movement, projection))
        print(f"{arc:g} degrees, {count} projections, detector {turn:g}: {series.mas:.1f} mAs, "
              f"{series.dose_mgy:.2f} mGy, t {series.mean_dose_factor:.3f}")  # fmt: skip
        for keys in ({"method": "fdk"}, {"method": "sart"}, {"method": "sart", "iterations": 4}):
            volume = reconstruct(series, **keys)
            print(f"  {keys}")
            report_clips(volume, breast, arc)
            report_calcifications(volume, breast)


def report_clips(volume: Reconstruction, breast: BreastPhantom, arc_deg: float) -> None:
    """Errors of place, and widths in depth."""
    widths = []
    for lesion in breast.lesions[:3]:
        truth = volume.gantry.gantry_from_breast(lesion.position_mm)
        index = volume.grid.voxel_of(truth)
        found = volume.grid.gantry_from_voxel(peak(volume.slices, index))
        depth, across = found[2] - truth[2], math.hypot(*(found - truth)[:2])
        widths.append(spread_mm(volume, index))
        print(f"    {lesion.name} at {truth[2]:.1f} mm: depth {depth:+.2f} mm, in plane "
              f"{across:.2f} mm; spread function {widths[-1]:.1f} mm wide")  # fmt: skip
    theory = 2.0 * (math.pi / 4.0 * CLIP_MM) / math.tan(math.radians(0.5 * arc_deg))
    print(f"    spread function: mean {np.mean(widths):.1f} mm; shift and add {theory:.1f} mm")


def peak(slices: NDArray[np.float32], index: NDArray[np.float64]) -> NDArray[np.float64]:
    """Centre of the upper half of the peak nearest to a voxel, along each axis."""
    reach = np.array([8, 8, 8])
    start = np.maximum(np.rint(index).astype(int) - reach, 0)
    stop = np.minimum(np.rint(index).astype(int) + reach + 1, slices.shape)
    box = slices[tuple(slice(a, b) for a, b in zip(start, stop, strict=True))]
    top = np.clip(box - np.median(box) - 0.5 * (box.max() - np.median(box)), 0.0, None)
    axes = [tuple({0, 1, 2} - {axis}) for axis in range(3)]
    return start + [
        np.average(np.arange(box.shape[axis]), weights=top.sum(axes[axis])) for axis in range(3)
    ]


def spread_mm(volume: Reconstruction, index: NDArray[np.float64]) -> float:
    """Full width at half maximum of the artefact spread function: contrast over depth, mm."""
    _, row, column = np.rint(index).astype(int)
    near = volume.slices[:, row - 1 : row + 2, column - 1 : column + 2].mean(axis=(1, 2))
    ring = volume.slices[:, row - 30 : row + 31, column - 30 : column + 31]
    contrast = near - np.median(ring, axis=(1, 2))
    half, top = 0.5 * contrast.max(), int(contrast.argmax())
    width = 0.0
    for way in (1, -1):
        at = top
        while 0 < at < contrast.size - 1 and contrast[at + way] > half:
            at += way
        below = contrast[min(max(at + way, 0), contrast.size - 1)]
        width += abs(at - top) + float((contrast[at] - half) / max(contrast[at] - below, 1e-12))
    return width * volume.grid.slice_mm


def report_calcifications(volume: Reconstruction, breast: BreastPhantom) -> None:
    """Contrast over noise, of single voxels at known places in the slice that holds them."""
    specks = breast.lesions[3]
    where = np.argwhere(breast.labels == specks.label) * breast.voxel_mm + breast.origin_mm
    index = np.rint(volume.grid.voxel_of(volume.gantry.gantry_from_breast(where))).astype(int)
    ratios = []
    for slice_, row, column in index:
        around = volume.slices[slice_, row - 12 : row + 13, column - 12 : column + 13].copy()
        value = float(around[12, 12])
        around[8:17, 8:17] = np.nan
        ratios.append((value - np.nanmean(around)) / np.nanstd(around))
    error = np.std(ratios, ddof=1) / math.sqrt(len(ratios))
    print(f"    calcification of {CALCIFICATION_MM:g} mm: contrast-to-noise ratio "
          f"{np.mean(ratios):.1f} +- {error:.1f}")  # fmt: skip


if __name__ == "__main__":
    main()
