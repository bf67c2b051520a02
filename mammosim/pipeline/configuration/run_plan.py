"""What a run will do, and about how much memory and time it takes, before anything is computed."""

from __future__ import annotations

from dataclasses import dataclass

from mammosim.acquisition import magnification_warnings
from mammosim.compression import MODELS, CompressionSettings
from mammosim.errors import InputError
from mammosim.phantom import PhantomSettings, address_bytes, expected_voxels
from mammosim.pipeline.configuration.resolved_view import ResolvedView
from mammosim.pipeline.configuration.run_config import RunConfig
from mammosim.plausibility import plausibility_warnings
from mammosim.reconstruction import reconstruction_gb, reconstruction_seconds

# Bytes and seconds below were measured with benchmarks/pipeline.py (see benchmarks/RESULTS.md) on
# as many cores; the estimates are rounded up and only meant to tell minutes from hours.
PLANNED_CORES = 2

BYTES_PER_VOXEL = 1.3
"""Fine labels: one byte, and what reading or generating them needs beside it."""

BYTES_PER_PIXEL = 130.0
"""Path lengths of about eight tissues, twice in single precision, and the exposure's images."""

BYTES_PER_CONTRAST_PIXEL = 30.0
"""Of a second exposure with a contrast agent: signal and its second moment, counts, iodine."""

BYTES_PER_LESION_PIXEL = 4.0
"""Of each lesion's mask, and of the segmentation while it is packed; measured 2.5 with 30 to 100
clips. Its path lengths take memory only where rays meet it."""

BYTES_PER_PROJECTED_PIXEL = 3.0
"""Of a series of projections: 16 bits, and one byte of the lesions' mask."""

BYTES_PER_DRAWN_PIXEL = 30.0
"""Of what arrives at the detector, twice more in single precision and second moment, and of one
draw's images, where several realisations are made."""

BYTES_PER_MAPPED_MM3 = 80.0
"""Of a dose map: each of 16 batches' energy in a coarse voxel of 1 mm, and the voxel itself."""

SECONDS_PER_WRITTEN_PIXEL, SECONDS_PER_MEASURED_PIXEL, SECONDS_PER_PAGE_PIXEL = 2e-7, 4e-7, 1e-7
"""Files of a view's image, what the page tells of it, and the page. Measured in the quickstart: 1,
2 and 0.5 s a view behind the last exposure; volumes are written beside the stages before."""

SECONDS_PER_DRAWN_PIXEL = 6e-7
"""Noise and processing of one more draw, and its files."""

BASE_BYTES = 4.5e8
"""The interpreter with its libraries and compiled code."""

SHADOW_SHARE, USUAL_MM = 0.5, 50.0
"""Part of the detector that a breast's shadow covers over an arc, and a compressed thickness where
it is not known yet, for the size of a reconstruction. Assumed."""

COMPILER_BYTES = 8e8
"""Numba and LLVM while they compile the kernels, in the first run after an installation."""

MAPPED_BYTES = 5e8
"""Of the address space mapped by libraries and threads but not used: with 1.3 GB estimated, a run
needs a limit (``ulimit -v``) between 1.2 and 1.5 GB."""

UNEVEN_IODINE = (
    "acquisition.contrast: springs do not conserve the volume of tissue, and the resulting "
    "unevenness is as bright in the iodine image as a lesion; compression.model: hyperelastic "
    "conserves it"
)

START_S = 5.0
"""Until the first stage begins, s."""

SECONDS_PER_VOXEL = {"file": 4e-8, "generate": 3e-8}
SECONDS_PER_PIXEL = 2.5e-6
"""Time for a phantom's voxels, and for tracing and exposing a pixel, s: rough, for the estimate of
`check` only."""

POSTURE_SHARE, UNLOADING_SHARE = 0.15, 0.5
"""Time of a posture's equilibrium, and of the search for the shape without weight, over that of a
compression. Measured on 550 mL with elements of 4 and 6 mm."""

PROJECTION_SHARE = 0.5
"""Of the time of projection and acquisition. Measured: 0.41 and 0.63 in the example's views."""


@dataclass(frozen=True)
class PlannedStage:
    """A stage that takes long.

    Parameters
    ----------
    view : str
        What the run calls the view, without its side, as `CC`; empty for a stage of the whole run.
    stage : str
        The name that the run shows in its progress.
    seconds : float
        Estimated duration on `PLANNED_CORES` cores, s.
    """

    view: str
    stage: str
    seconds: float


@dataclass(frozen=True)
class Plan:
    """The stages of a run in words, and its estimated needs on `PLANNED_CORES` cores.

    `warnings` are what the settings alone make doubtful, one sentence each; `stages` are those
    that take long, in their order.
    """

    lines: tuple[str, ...]
    memory_gb: float
    stages: tuple[PlannedStage, ...]
    warnings: tuple[str, ...] = ()

    @property
    def minutes(self) -> float:
        """Estimated duration, min."""
        return (START_S + sum(stage.seconds for stage in self.stages)) / 60.0


def make_plan(config: RunConfig) -> Plan:
    """Plan a run from its configuration alone.

    Parameters
    ----------
    config : RunConfig

    Returns
    -------
    Plan
        What `mammosim check` says: a line per breast and view, memory in GB, the time of each stage
        on two cores, and warnings.

    Notes
    -----
    The size of a phantom is read from its header or from the generator's settings; nothing is
    computed. Time and memory are figures measured per voxel, node and pixel, times their numbers.
    """
    both = len(config.sides) > 1
    sides = [_plan_side(one, str(one.first_side) if both else "") for one in config.sides]
    lines = [line for side in sides for line in side.lines]
    lines += _target_lines(config)
    memory = BASE_BYTES + COMPILER_BYTES + sum(side.voxels * BYTES_PER_VOXEL for side in sides)
    memory += max(side.view_bytes for side in sides) * sum(side.views for side in sides)
    memory += max(side.mask_bytes for side in sides)
    stages = [side.phantom_stage for side in sides]
    stages += [stage for side in sides for stage in side.view_stages]
    stages += [stage for side in sides for stage in side.sample_stages]
    pixels = sum(side.pixels for side in sides)
    measured = SECONDS_PER_MEASURED_PIXEL if config.report.html else 0.0
    stages += [
        PlannedStage("", "export", pixels * (SECONDS_PER_WRITTEN_PIXEL + measured)),
        PlannedStage("", "report", pixels * SECONDS_PER_PAGE_PIXEL),
    ]
    warnings = dict.fromkeys(text for one in config.sides for text in _warnings(one))
    return Plan(tuple(lines), memory / 1e9, tuple(stages), tuple(warnings))


@dataclass(frozen=True)
class _SidePlan:
    """What one breast takes: its plan in words, voxels, views, pixels of all, bytes of its largest
    view, and its stages."""

    lines: tuple[str, ...]
    voxels: int
    views: int
    pixels: float
    view_bytes: float
    mask_bytes: float
    phantom_stage: PlannedStage
    view_stages: tuple[PlannedStage, ...]
    sample_stages: tuple[PlannedStage, ...]


def _plan_side(config: RunConfig, named: str) -> _SidePlan:
    """Plan of one breast; its lines name the side if `named` does."""
    side = config.first_side or "L"
    voxels, voxel_volume_mm3 = expected_voxels(config.phantom, config.seed, side)
    source = _source(config.phantom, voxels)
    lines = [f"{named}: {source}" if named else source]
    kind = "file" if config.phantom.file else "generate"
    made = PlannedStage("", "phantom", voxels * SECONDS_PER_VOXEL[kind])
    stages: list[PlannedStage] = []
    sampled: list[PlannedStage] = []
    largest = masks = all_pixels = 0.0
    lesions = len(config.phantom.lesions)
    for view in config.resolved_views:
        compression, projection, sweep = view.compression, view.projection, view.tomosynthesis
        nodes = lattice_bytes = 0.0
        model = MODELS[compression.model]
        if model.compresses:
            nodes = voxels * voxel_volume_mm3 / compression.resolution_mm**3
            lattice_bytes = nodes * model.bytes_per_node
            shaped = UNLOADING_SHARE if config.phantom.shaped_under != "none" else 0.0
            seconds = model.seconds(compression, nodes) * (1.0 + shaped)
            stages.append(PlannedStage(view.label, "compression", seconds))
            again = compression.model_copy(update=dict(model.sample_keys))
            seconds = model.seconds(again, nodes)
            sampled += [
                PlannedStage(where, stage, seconds * count)
                for where, stage, count in _more_compressions(config, view.label, shaped)
            ]
        height, width = projection.detector_mm or (240.0, 180.0)
        pixels = height * width / projection.pixel_mm**2
        all_pixels += pixels
        stack, drawn = _picture_bytes(view, pixels, voxels * voxel_volume_mm3)
        largest = max(largest, lattice_bytes + pixels * BYTES_PER_PIXEL + stack + drawn)
        masks = max(masks, pixels * lesions * BYTES_PER_LESION_PIXEL)
        stages += _picture_stages(view, pixels)
        line = _view_line(named + view.label, compression, projection.pixel_mm, nodes, pixels)
        if sweep and sweep.reconstruct is not None:
            thickness_mm = compression.thickness_mm or USUAL_MM
            used, voxels_made = view.reconstructed(SHADOW_SHARE * height * width, thickness_mm)
            slices_gb = reconstruction_gb(used, voxels_made, sweep.reconstruct.method)
            largest = max(largest, 1e9 * slices_gb + stack)
            seconds = reconstruction_seconds(sweep.projections, voxels_made, sweep.reconstruct)
            stages.append(PlannedStage(view.label, "reconstruction", seconds))
        if sweep:
            line += (
                f", from {sweep.projections} tube positions over {sweep.angle_range_deg:g} degrees"
            )
        lines.append(line)
    return _SidePlan(
        tuple(lines), voxels, len(config.resolved_views), all_pixels, largest, masks, made,
        tuple(stages),
        tuple(sorted(sampled, key=lambda stage: stage.stage)),  # biopsies before uncertainty
    )  # fmt: skip


def _picture_bytes(view: ResolvedView, pixels: float, breast_mm3: float) -> tuple[float, float]:
    """Bytes of a view's projections, contrast and dose map, and those of its noise realisations."""
    acquisition, sweep = view.acquisition, view.tomosynthesis
    stack = pixels * sweep.projections * BYTES_PER_PROJECTED_PIXEL if sweep else 0.0
    if acquisition.contrast is not None:
        stack += pixels * BYTES_PER_CONTRAST_PIXEL
    if view.dose_map and acquisition.scatter_model == "monte-carlo":
        stack += breast_mm3 * BYTES_PER_MAPPED_MM3
    return stack, pixels * BYTES_PER_DRAWN_PIXEL if (acquisition.realisations or 1) > 1 else 0.0


def _picture_stages(view: ResolvedView, pixels: float) -> list[PlannedStage]:
    """Projection and acquisition of a view."""
    acquisition, sweep = view.acquisition, view.tomosynthesis
    seconds = pixels * SECONDS_PER_PIXEL * (sweep.projections if sweep else 1)
    if acquisition.contrast is not None:
        seconds += pixels * SECONDS_PER_PIXEL
    seconds += pixels * SECONDS_PER_DRAWN_PIXEL * ((acquisition.realisations or 1) - 1)
    if sweep:
        return [PlannedStage(view.label, "projections", seconds)]
    shares = {"projection": PROJECTION_SHARE, "acquisition": 1.0 - PROJECTION_SHARE}
    return [PlannedStage(view.label, stage, share * seconds) for stage, share in shares.items()]


def _warnings(config: RunConfig) -> list[str]:
    """What the settings alone make doubtful, by the table of limits and by each model."""
    found: list[str] = []
    for view in config.resolved_views:
        compression = view.compression
        found += MODELS[compression.model].cautions(compression)
        given = {
            "compressed_thickness_mm": compression.thickness_mm,
            "tube_load_mas": view.acquisition.mas,
        }
        sweep = view.tomosynthesis
        if sweep is not None and view.acquisition.scatter_model != "monte-carlo":
            given["unknown_dose_angle_deg"] = max(abs(angle) for angle in sweep.angles_deg)
        known = {name: value for name, value in given.items() if value is not None}
        texts = [str(warning) for warning in plausibility_warnings(known)]
        if sweep is None:  # whose tube turns about a breast on the detector
            texts += magnification_warnings(
                view.projection.magnification,
                view.acquisition.focal_spot_mm,
                view.acquisition.grid,
            )
        if view.acquisition.contrast is not None and not MODELS[compression.model].keeps_volume:
            texts.append(UNEVEN_IODINE)
        found += [f"{view.label}: {text}" for text in texts]
    return found


def check_memory_limit(plan: Plan) -> None:
    """Refuse a run that this process' own limit of memory would end.

    Raises
    ------
    InputError
        With both numbers: libraries in C end a process that gets no memory by an abort.
    """
    allowed = address_bytes()
    needed = plan.memory_gb * 1e9 + MAPPED_BYTES
    if allowed is not None and needed > allowed:
        raise InputError(
            f"not enough memory: a limit of {allowed / 1e9:.2g} GB is set (ulimit -v), this run "
            f"needs about {needed / 1e9:.2g} GB with its libraries"
        )


def _more_compressions(
    config: RunConfig, label: str, shaped: float
) -> list[tuple[str, str, float]]:
    """View, stage and time beside a view's own: at biopsy, and of the samples, in compressions.

    `shaped` is what freeing the breast from its weight takes each time.
    """
    targets = config.targets
    biopsy, held = targets.biopsy, 0.0
    if biopsy is not None and biopsy.view != "none":
        held = 1.0 + shaped
    elif biopsy is not None and biopsy.posture is not None:
        held = POSTURE_SHARE + shaped
    samples = targets.uncertainty.samples if targets.uncertainty is not None else 0
    found = [("", "biopsy", held), (label, "uncertainty", samples * (1.0 + shaped + held))]
    return [(view, stage, time) for view, stage, time in found if time]


def _target_lines(config: RunConfig) -> list[str]:
    targets, lines = config.targets, []
    if targets.biopsy is not None:
        held = {"none": "without plates", "same": "in each view"}.get(
            targets.biopsy.view, f"in {targets.biopsy.view}"
        )
        if targets.biopsy.posture is not None:
            held += f", the woman {targets.biopsy.posture} (experimental)"
        lines.append(f"biopsy: a {targets.biopsy.needle} needle, the breast held {held}")
    if targets.uncertainty is not None:
        lines.append(f"uncertainty: {targets.uncertainty.samples} samples of each compression")
    return lines


def _source(phantom: PhantomSettings, voxels: int) -> str:
    source = phantom.file if phantom.file else "generated"
    return f"phantom: {source}, {voxels / 1e6:.1f} million voxels"


def _view_line(
    name: str, compression: CompressionSettings, pixel_mm: float, nodes: float, pixels: float
) -> str:
    model = MODELS[compression.model]
    if not model.compresses:
        how = model.method(compression)
    else:
        if compression.thickness_mm is not None:
            goal = f"to {compression.thickness_mm:g} mm"
        elif compression.force_n is not None:
            goal = f"with {compression.force_n:g} N"
        elif compression.paddle_z_mm is not None and compression.support_z_mm is not None:
            goal = f"to {compression.paddle_z_mm - compression.support_z_mm:g} mm"
        else:
            goal = "to the population fit's thickness, at most 80 % of the breast's height"
        method = model.method(compression)
        how = f"compressed {goal} ({method}, at most {nodes / 1e6:.2f} million nodes)"
    return f"{name}: {how}; projected onto {pixels / 1e6:.1f} million pixels of {pixel_mm:g} mm"
