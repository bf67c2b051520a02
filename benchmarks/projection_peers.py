"""Other projectors on a job of benchmarks/projection.py; runs in an interpreter that has them.

    python benchmarks/projection_peers.py FOLDER

reads FOLDER/job.npz and writes FOLDER/rows.json: name, wall and CPU seconds, and the file of the
picture that each made. Peers that are not installed are passed over and said so.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np

TURNS = 5


def main() -> None:
    """Run every peer that the job asks for and that is installed."""
    folder = Path(sys.argv[1])
    job = dict(np.load(folder / "job.npz"))
    peers = (gecatsim, rtk_one) if job["what"] == "one" else (warp_and_project,)
    rows = []
    for peer in peers:
        try:
            name, picture, wall, cpu = peer(job)
        except ImportError as error:
            print(f"  {peer.__name__}: not installed ({error})")
            continue
        np.save(folder / f"{peer.__name__}.npy", picture)
        rows.append({"name": name, "wall": wall, "cpu": cpu, "picture": f"{peer.__name__}.npy"})
    (folder / "rows.json").write_text(json.dumps(rows))


def timed(work, turns=TURNS):
    """Result, and the least wall and CPU seconds of some turns."""
    walls, cpus = [], []
    for _ in range(turns):
        wall, cpu = time.perf_counter(), time.process_time()
        result = work()
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    return result, min(walls), min(cpus)


def gecatsim(job):
    """Distance-driven projection of gecatsim; their y is our z, their x our x, their z our y."""
    from gecatsim.pyfiles.C_DD3Proj_mm import DD3Proj_mm

    n, voxel = job["volume"].shape[0], np.single(job["voxel_mm"])
    half = 0.5 * n * float(voxel)
    volume = np.ascontiguousarray(job["volume"].transpose(2, 0, 1)[::-1, :, ::-1])
    across = job["row_y_mm"][::-1].astype(np.single)
    along = (job["column_x_mm"] - half).astype(np.single)
    depth = np.full(along.size, -(float(job["gap_mm"]) + half), np.single)
    zero, mask = np.zeros(1, np.single), np.ones((2 * n, n), np.uint8)
    spot = float(job["focal_spot_mm"][2]) - half

    def work():
        return DD3Proj_mm(-half, spot, 0.0, along.size, across.size, along, depth, across, 0.0, 0.0,
                          0.0, zero, zero, 1, n, n, n, volume, voxel, voxel, mask)  # fmt: skip

    sinogram, wall, cpu = timed(work)
    return "gecatsim, distance driven, one channel", sinogram[0].T, wall, cpu


def rtk_one(job):
    """RTK's Joseph projector on one thread."""
    n, voxel = job["volume"].shape[0], float(job["voxel_mm"])
    half = 0.5 * n * voxel
    image = _image(job["volume"], [voxel] * 3, [0.5 * voxel, *[0.5 * voxel - half] * 2], threads=1)
    picture, wall, cpu = timed(_joseph(image, job, half))
    return "RTK, Joseph, one channel", picture()[0], wall, cpu


def _image(volume, spacing, origin, threads):
    import itk

    itk.MultiThreaderBase.SetGlobalDefaultNumberOfThreads(int(threads))
    image = itk.image_view_from_array(np.ascontiguousarray(volume.transpose(2, 1, 0)))
    image.SetSpacing([float(step) for step in spacing])
    image.SetOrigin([float(at) for at in origin])
    return image


def _joseph(image, job, middle_z):
    """A call that projects an image [x, y, z above `middle_z`] and gives a call for its picture."""
    import itk
    from itk import RTK as rtk

    spot, gap = job["focal_spot_mm"], float(job["gap_mm"])
    geometry = rtk.ThreeDCircularProjectionGeometry.New()
    geometry.AddProjection(float(spot[2]) - middle_z, float(spot[2]) + gap, 0.0, 0.0, 0.0, 0.0, 0.0,
                           float(spot[0]), float(spot[1]))  # fmt: skip
    rows, columns, pixel = int(job["rows"]), int(job["columns"]), float(job["pixel_mm"])
    x, y = job["column_x_mm"], job["row_y_mm"]
    low_x, low_y = float(min(x[0], x[-1])), float(min(y[0], y[-1]))

    def work():
        detector = itk.image_from_array(np.zeros((1, rows, columns), np.float32))
        detector.SetSpacing([pixel, pixel, 1.0])
        detector.SetOrigin([low_x, low_y, 0.0])
        kind = type(image)
        projector = rtk.JosephForwardProjectionImageFilter[kind, kind].New()
        projector.SetGeometry(geometry)
        projector.SetInput(0, detector)
        projector.SetInput(1, image)
        projector.Update()
        return lambda: _as_ours(itk.array_from_image(projector.GetOutput())[0], x, y)

    return work


def _as_ours(picture, x, y):
    """Rows and columns in our order."""
    picture = picture if x[0] < x[-1] else picture[:, ::-1]
    return (picture if y[0] < y[-1] else picture[::-1])[None]


def warp_and_project(job):
    """Warp the labels with SimpleITK, then project once a tissue with RTK."""
    import SimpleITK as sitk

    threads = int(job["threads"])
    sitk.ProcessObject.SetGlobalDefaultNumberOfThreads(threads)
    labels, voxel = job["volume"], job["voxel_mm"]
    fine = sitk.GetImageFromArray(np.ascontiguousarray(labels.transpose(2, 1, 0)))
    fine.SetSpacing([float(step) for step in voxel])
    fine.SetOrigin([float(at) for at in job["origin_mm"]])
    transform, low, high = _displacement(job)
    step = float(voxel.min())
    shape = [int(n) for n in np.ceil((high - low) / step)]

    def warp():
        resample = sitk.ResampleImageFilter()
        resample.SetSize(shape)
        resample.SetOutputSpacing([step] * 3)
        resample.SetOutputOrigin([float(at) for at in low])
        resample.SetInterpolator(sitk.sitkNearestNeighbor)
        resample.SetTransform(transform)
        return sitk.GetArrayFromImage(resample.Execute(fine)).transpose(2, 1, 0)

    warped, wall, cpu = timed(warp, 1)
    print(f"  (warp alone: {wall:.2f} s, {cpu:.2f} CPU s)")
    total = None
    edge, support = float(job["detector_edge_mm"]), float(job["support_z_mm"])
    middle = 0.5 * (high[2] + low[2]) - support
    origin = low - [edge, 0.0, support + middle]
    for channel in range(1, int(job["channels"].max()) + 1):

        def tissue(channel=channel):
            wanted = (job["channels"] == channel).astype(np.float32)
            # Looked up in the order in which the array lies in memory, so that nothing is copied.
            part = wanted[warped.transpose(2, 1, 0)].transpose(2, 1, 0)
            return _joseph(_image(part, [step] * 3, origin, threads), job, middle)()

        picture, more_wall, more_cpu = timed(tissue, 1)
        wall, cpu = wall + more_wall, cpu + more_cpu
        total = picture()[0] + (0.0 if total is None else total)
    return "SimpleITK warp, then RTK Joseph once a tissue", total, wall, cpu


def _displacement(job):
    """The inverse map as a transform from the compressed breast to the phantom, and its extent."""
    import SimpleITK as sitk

    original = job["original_mm"].astype(np.float64)
    low, spacing = job["inverse_origin_mm"], job["inverse_spacing_mm"]
    nodes = low + np.moveaxis(np.indices(original.shape[:3]), 0, -1) * spacing
    known = np.isfinite(original).all(axis=-1)
    back = original @ job["rotation"] - nodes  # the phantom's own axes
    back[~known] = 1e4  # far outside, so air
    field = sitk.GetImageFromArray(np.ascontiguousarray(back.transpose(2, 1, 0, 3)), isVector=True)
    field.SetSpacing([float(step) for step in spacing])
    field.SetOrigin([float(at) for at in low])
    places = nodes[known]
    return sitk.DisplacementFieldTransform(field), places.min(axis=0), places.max(axis=0)


if __name__ == "__main__":
    main()
