"""What `mammosim locate` answers, in lines of text."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.pipeline import LocatedInRun
from mammosim.targets import Located, RayCurve, clock_position

SAME_LESION_MM = 3.0
"""On the detector; a reader marks a lesion's middle to a few mm (assumed)."""


def located_lines(located: LocatedInRun) -> list[str]:
    """What pixels show, in lines of text."""
    lines = [f"note: the compression of {name} did not converge" for name in located.not_converged]
    if isinstance(located.found, Located):
        return lines + _point(located, located.found)
    return lines + _curve(located.found, located.nipple_mm)


def _point(located: LocatedInRun, found: Located) -> list[str]:
    x, y, z = found.point_mm
    lines = [
        f"uncompressed: x {x:.2f}, y {y:.2f}, z {z:.2f} mm (anterior, patient's left, superior)",
        f"{clock_position(found.point_mm, located.nipple_mm)}, "
        f"{np.linalg.norm(found.point_mm - located.nipple_mm):.1f} mm from the nipple",
    ]
    for image_point, height, misfit in zip(
        located.image_points, found.height_mm, found.misfit_mm, strict=True
    ):
        line = f"{image_point.what}: {height:.2f} mm above the breast support"
        if len(located.image_points) > 1:
            line += f"; the point's image is {misfit:.2f} mm from the pixel"
        lines.append(line)
    if max(found.misfit_mm) > SAME_LESION_MM:
        lines.append(
            f"note: no point is within {SAME_LESION_MM:g} mm of both pixels; do they show the "
            f"same lesion?"
        )
    return lines


def _curve(curve: RayCurve, nipple_mm: NDArray[np.float64]) -> list[str]:
    lines = ["height mm      x mm      y mm      z mm   clock  from nipple mm"]
    for height, point in zip(curve.height_mm, curve.point_mm, strict=True):
        place = "".join(f"{value:10.2f}" for value in point)
        distance = float(np.linalg.norm(point - nipple_mm))
        lines.append(f"{height:9.1f}{place}{clock_position(point, nipple_mm):>8}{distance:16.1f}")
    return [
        *lines,
        "uncompressed breast: x anterior, y patient's left, z superior; height above the breast "
        "support during compression",
    ]
