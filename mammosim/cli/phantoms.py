"""Commands about phantom files: info, convert."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mammosim.cli.terminal import app, exit_status, say
from mammosim.errors import InputError

if TYPE_CHECKING:
    from mammosim.phantom import PhantomSummary

Labels = Annotated[
    str | None, typer.Option(help="Label map: a name, or a YAML file of label: tissue.")
]
Axes = Annotated[
    str | None,
    typer.Option(help="Directions of the file's axes, e.g. ALS (key phantom.axes)."),
]
VoxelMm = Annotated[
    str | None,
    typer.Option(help="Voxel size, mm: one number, or three, e.g. 0.2,0.2,0.5 (phantom.voxel_mm)."),
]
Reduce = Annotated[
    int, typer.Option(help="Keep one of every n voxels along each axis (phantom.reduce).")
]


@app.command()
def info(
    phantom: Annotated[Path, typer.Argument(help="A phantom file, or a folder of DICOM slices.")],
    labels: Labels = None,
    axes: Axes = None,
    voxel_mm: VoxelMm = None,
    reduce: Reduce = 1,
) -> None:
    """Show size, voxel size, extent, tissue volumes, orientation, side and lesions of a phantom."""
    with exit_status(result_is_text=True):
        from mammosim.phantom import phantom_summary, read_phantom

        breast = read_phantom(phantom, labels, None, axes, _sizes(voxel_mm), reduce)
        _print_phantom(phantom_summary(breast))


def _sizes(text: str | None) -> list[float] | float | None:
    """One number, or three between commas."""
    if text is None:
        return None
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 3):
        raise InputError(
            f"--voxel-mm: found '{text}', expected one number or three, e.g. 0.2,0.2,1"
        )
    return numbers[0] if len(numbers) == 1 else numbers


@app.command()
def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", help="What `info` reads.")],
    target: Annotated[
        Path,
        typer.Argument(metavar="OUT", help="Its extension sets the format, e.g. .nrrd or .mhd."),
    ],
    labels: Labels = None,
    axes: Axes = None,
    voxel_mm: VoxelMm = None,
    reduce: Reduce = 1,
) -> None:
    """Write a phantom in another format, with the same voxels at the same positions.

    With --labels, its values become mammosim's own labels; otherwise they do not change.
    """
    with exit_status():
        from mammosim.export import convert_volume

        done = convert_volume(source, target, labels, axes, _sizes(voxel_mm), reduce)
        sizes = " x ".join(str(side) for side in done.frame.shape)
        spacing = " x ".join(f"{step:g}" for step in done.frame.spacing_mm)
        found = ", ".join(str(label) for label in sorted(done.counts))
        say(f"wrote {target}: {sizes} voxels of {spacing} mm")
        say(f"labels: {found}")
        say(f"orientation: {done.orientation}")
        for note in done.notes:
            say(f"note: {note}")


def _print_phantom(summary: PhantomSummary) -> None:
    def spans(values: Any, pattern: str) -> str:
        return " x ".join(pattern.format(value) for value in values)

    extent = ", ".join(
        f"{axis} {low:.1f} to {high:.1f}"
        for axis, (low, high) in zip("xyz", summary.extent_mm, strict=True)
    )
    side = {"L": "left", "R": "right"}[summary.laterality]
    lines = [
        ("source", summary.source),
        ("size", f"{spans(summary.shape, '{}')} voxels of {spans(summary.voxel_mm, '{:g}')} mm"),
        ("orientation", summary.orientation),
        ("tissue", f"{extent} mm (x anterior, y patient's left, z superior)"),
        ("side", f"{side} ({summary.laterality})"),
        ("nipple", f"{', '.join(f'{value:.1f}' for value in summary.nipple_mm)} mm"),
        ("breast", f"{summary.breast_ml:.1f} mL without muscle"),
    ]
    if summary.fibroglandular_percent is not None:
        share = f"{summary.fibroglandular_percent:.1f} % of the volume within the skin"
        lines.append(("fibroglandular", share))
    lines += [(f"  {tissue}", f"{ml:.2f} mL") for tissue, ml in summary.volume_ml.items()]
    for lesion in summary.lesions:
        place = ", ".join(f"{value:.1f}" for value in lesion.position_mm)
        lines.append(
            ("lesion", f"{lesion.name} ({lesion.kind}), {lesion.volume_mm3:.1f} mm3 at {place} mm")
        )
    lines += [("note", note) for note in summary.notes]
    for heading, value in lines:
        say(f"{heading}: {value}")
