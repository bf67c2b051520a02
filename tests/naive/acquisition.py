"""Slow twins of the acquisition kernels, and path lengths of simple bodies to try them on."""

from __future__ import annotations

import math

import numpy as np

from mammosim.geometry import Gantry, View
from mammosim.projection.paths import PathLengths


def body_paths(lengths, *, pixel_mm=0.5, thickness_mm=50.0, view="CC", laterality="L"):
    """PathLengths of material -> image [row, column] of lengths in mm."""
    images = np.stack([np.asarray(image, dtype=np.float32) for image in lengths.values()])
    rows, columns = images.shape[1:]
    gantry = Gantry(
        view=View(view, laterality),
        detector_edge_mm=0.0,
        support_z_mm=0.0,
        source_to_detector_mm=650.0,
        support_to_detector_mm=15.0,
        focal_spot_y_mm=0.0,
        pixel_mm=pixel_mm,
        rows=rows,
        columns=columns,
        y_min_mm=-rows * pixel_mm / 2,
    )
    names = tuple(lengths)
    zeros = (0,) * len(names)
    return PathLengths(names, names, zeros, images, images, gantry, thickness_mm, 90.0, 0.0)


def half_disc(shape, pixel_mm, radius_mm):
    """Pixels within a half-disc whose centre is the middle of the chest-wall edge (column 0)."""
    y = (np.arange(shape[0]) + 0.5 - shape[0] / 2) * pixel_mm
    x = (np.arange(shape[1]) + 0.5) * pixel_mm
    return np.hypot(y[:, None], x[None, :]) < radius_mm


def primary(lengths_mm, mu_per_mm, weights, flat_depth, gantry):
    """Sum over energies behind each pixel, one pixel after the other."""
    tissues, rows, columns = lengths_mm.shape
    spot = gantry.focal_spot_mm
    out = np.zeros((rows, columns))
    for row in range(rows):
        for column in range(columns):
            x, y = gantry.detector_xy_mm(row, column)
            distance = math.dist((x, y, -gantry.support_to_detector_mm), spot)
            height = spot[2] + gantry.support_to_detector_mm
            cosine = height / distance
            total = 0.0
            for e, weight in enumerate(weights):
                depth = flat_depth[e] * (1.0 / cosine - 1.0)
                for t in range(tissues):
                    depth += mu_per_mm[e, t] * float(lengths_mm[t, row, column])
                total += weight * math.exp(-depth)
            fall = (height / distance) ** 2
            out[row, column] = total * fall * cosine
    return out


def bilinear(coarse, cell, row, column):
    """Value of a coarse image at a pixel, linear between cell centres, held beyond them."""
    rows, columns = coarse.shape
    y = np.clip((row + 0.5) / cell - 0.5, 0, rows - 1)
    x = np.clip((column + 0.5) / cell - 0.5, 0, columns - 1)
    total = 0.0
    for i in range(rows):
        for j in range(columns):
            total += coarse[i, j] * max(0.0, 1 - abs(y - i)) * max(0.0, 1 - abs(x - j))
    return total


def with_scatter(coarse, cell, parts, signal, square):
    """Signal and second moment behind a grid that lets parts of primary and scatter through."""
    out = np.array([signal, square], dtype=float)
    for row, column in np.ndindex(signal.shape):
        total = parts[0] * signal[row, column] + parts[1] * bilinear(coarse, cell, row, column)
        mean_energy = square[row, column] / signal[row, column] if signal[row, column] > 0 else 0.0
        out[:, row, column] = total, total * mean_energy
    return out


def log_attenuation(signal, air_signal, mean_depth, gantry):
    """ln of air's signal over a pixel's own, both for a ray at right angles to the detector."""
    out = np.zeros(signal.shape)
    spot = gantry.focal_spot_mm
    for row, column in np.ndindex(signal.shape):
        x, y = gantry.detector_xy_mm(row, column)
        distance = math.dist((x, y, -gantry.support_to_detector_mm), spot)
        cosine = (spot[2] + gantry.support_to_detector_mm) / distance
        air = air_signal[min(column, len(air_signal) - 1)]
        oblique = cosine**3 * math.exp(-mean_depth * (1 / cosine - 1))
        out[row, column] = math.log(air / max(signal[row, column] / oblique, 1e-6 * air))
    return out


def bent(value, toe, shoulder, white):
    """Straight, with an exponential toe and a shoulder that is a hyperbola."""
    if value < toe:
        return toe * np.exp(value / toe - 1.0)
    if value > shoulder:
        left = white - shoulder
        return white - left / (1.0 + (value - shoulder) / left)
    return value


def grey(attenuation, missing, edge, rise, evened, base, middle, even, reach, nipple, curve):
    """Grey (0 to 1) of one pixel, coarse images given where it is."""
    left = (reach[1] - rise) / (reach[1] - reach[0])  # of the edge's reach
    ramps = np.clip([rise, 0.5 * rise, left], 0.0, 1.0)
    part, inner, near = (3.0 * t**2 - 2.0 * t**3 for t in ramps)
    level = (1.0 - evened) * (attenuation + missing + near * edge) + evened * nipple
    slope = (curve.gland_grey - curve.fat_grey) / curve.contrast

    def with_toe(value):
        return bent(value, curve.toe, np.inf, np.inf)

    straight = curve.fat_grey + slope * (base - curve.fat)
    below = bent(straight, curve.toe, curve.shoulder, curve.white)
    weak = np.array([middle - base, level - middle])
    strength = np.abs(weak).sum() / (0.23 * curve.contrast * min(curve.contrast / 0.95, 1.0))
    weak *= inner * np.tanh(strength) / strength
    strong = level - base - weak.sum()
    weak *= (curve.wide_gain, 1.0 + (curve.fine_gain - 1.0) * (0.5 + 0.5 * even))
    gain = 1.0 + (curve.fine_gain - 1.0) * (0.5 + 0.5 * even)
    growth = np.exp(max(base - curve.fat, 0.0) / 2.0)
    grain = gain * 0.012 * growth * np.tanh(weak[1] / gain / 0.012 / growth)
    enhanced = weak.sum() - grain
    # where the toe is flatter than 0.34, weak detail is raised to that slope, by 20 at most
    toe_slope = np.clip(below / curve.toe, 0.05, 1.0)
    raised = straight + slope * (strong + max(0.34 / toe_slope, 1.0) * enhanced)
    # the derivative of the shoulder, no less than 0.32; but for weak wide detail 0.75 away from
    # steps; grain, less where it grows, moves along a sigmoid instead
    left = (curve.white - below) / (curve.white - curve.shoulder)
    shoulder_slope = np.clip(left**2, 0.32, 1.0)
    shown = below + shoulder_slope * (with_toe(raised) - with_toe(straight))
    shown += slope * max(0.75 - shoulder_slope, 0.0) * even * weak[0]
    shown = np.clip(shown, 1e-9, 1.0 - 1e-9)
    odds = shown / (1.0 - shown) * np.exp(2.8 * slope * grain / growth)
    shown = odds / (1.0 + odds)
    shown = bent(max(shown, 0.0), 0.0, 0.85, 1.0)
    return part * shown * min(1.0, np.exp((raised - (curve.fat_grey - 0.4)) / 0.1))


def boone_ratio(diameter_cm, thickness_cm):
    """Scatter over primary of a semicircle, Mo/Mo, air gap 15 mm: Boone et al. 2000."""
    return 1.0 / (-2.354528 + 22.396098 * diameter_cm**-1.5 + 8.850643 * thickness_cm**-0.5)


def gaussian_mean(image, sigma):
    """Mean around each cell with the weights of a Gaussian, cells beyond an edge as those at it."""
    reach = int(4.0 * sigma + 0.5)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    for axis in (0, 1):
        at = np.arange(-reach, reach + 1)[:, None] + np.arange(image.shape[axis])
        lines = np.take(image, np.clip(at, 0, image.shape[axis] - 1), axis=axis)
        image = np.tensordot(weights / weights.sum(), lines, (0, axis))
    return image


def layered(beam, layers, cell_mm, tangents, multiple, around_mm, mean_way):
    """Sum over all pairs of cells and all layers, for parallel rays and one energy."""
    rows, columns = beam.shape
    depths = [layer.depth[0] for layer in layers]
    turbid = sum(layer.emission.albedo[0] * layer.depth[0] for layer in layers)
    turbid = gaussian_mean(turbid, around_mm / cell_mm)
    again = multiple[0] * turbid / (1.0 + multiple[1] * turbid)
    whole = sum(depths) > 0.5 * sum(depths).max()
    out = np.zeros((rows, columns))
    for number, layer in enumerate(layers):
        h = layer.height_mm
        weights = [
            0.0 if low.plate else (0.5 if low is layer else 1.0) for low in layers[: number + 1]
        ]
        near = sum(
            w * low.height_mm / h * d
            for w, low, d in zip(weights, layers[: number + 1], depths, strict=False)
        ) + np.zeros(beam.shape)
        far = sum(
            w * (1.0 - low.height_mm / h) * d
            for w, low, d in zip(weights, layers[: number + 1], depths, strict=False)
        ) + np.zeros(beam.shape)
        mean = (near + far)[whole].mean()
        above = sum(
            (0.5 if high is layer else 1.0) * d
            for high, d in zip(layers[number:], depths[number:], strict=True)
            if not high.plate
        ) + np.zeros(beam.shape)
        source = beam * np.exp(-above - near) * depths[number]

        def kernel(r, layer=layer, mean=mean, h=h):
            secant = np.sqrt(1.0 + (r / h) ** 2)
            weight = (cell_mm / h) ** 2 / secant**3 * np.exp(-mean * (secant - 1.0)) * (r <= 120.0)
            return weight * np.interp(r / h, tangents, layer.emission.per_sr[0]), weight

        ring = np.arange(0.25, 120.0, 0.5)
        ratio = np.divide(*((part * ring).sum() for part in kernel(ring)))
        for i in range(rows):
            for j in range(columns):
                arriving, along = 0.0, np.zeros(2)
                for k in range(rows):
                    for m in range(columns):
                        one, flat = kernel(cell_mm * math.hypot(i - k, j - m))
                        sent = source[k, m] * (one + again[k, m] * ratio * flat)
                        arriving += sent
                        along += sent * np.array([k - i, m - j])
                along *= mean_way / arriving
                met = sum(
                    w * (1.0 - low.height_mm / h) * between(d, (i, j) + low.height_mm / h * along)
                    for w, low, d in zip(weights, layers[: number + 1], depths, strict=False)
                )
                out[i, j] += arriving * math.exp(-met)
    return out


def between(image, place):
    """Bilinear interpolation inside an image."""
    i, j = (min(int(at), size - 2) for at, size in zip(place, image.shape, strict=True))
    u, v = place[0] - i, place[1] - j
    upper = (1.0 - v) * image[i, j] + v * image[i, j + 1]
    lower = (1.0 - v) * image[i + 1, j] + v * image[i + 1, j + 1]
    return (1.0 - u) * upper + u * lower


def edge_paths(pixel_mm, size=260, angle_deg=2.0, material="titanium", length_mm=0.3):
    """A plate that lets a tenth through; its slanted edge runs down the middle of a square."""
    row, column = np.indices((size, size))
    slope = np.tan(np.radians(angle_deg))
    beyond = column - size / 2 > slope * (row - size / 2)
    return body_paths({material: beyond * length_mm}, pixel_mm=pixel_mm)


def slab_paths(pixel_mm, length_mm, size=512, material="adipose", **keys):
    """A slab over the whole picture, its length along every ray the same."""
    return body_paths({material: np.full((size, size), length_mm)}, pixel_mm=pixel_mm, **keys)


def disc_paths(pixel_mm, thickness_mm=50.0, disc_mm=4.0, radius_mm=8.0, size=400):
    """A slab of fat in which a disc of gland has taken the place of some of it."""
    at = (np.arange(size) + 0.5 - size / 2) * pixel_mm
    inside = np.hypot(at[:, None], at[None, :]) < radius_mm
    lengths = {"adipose": thickness_mm - disc_mm * inside, "gland": disc_mm * inside}
    return body_paths(lengths, pixel_mm=pixel_mm, thickness_mm=thickness_mm)


def semicircle_paths(diameter_cm, thickness_cm, pixel_mm=1.0, margin_mm=20.0):
    """A homogeneous semicircular breast at the chest-wall edge, as scatter was tabulated for."""
    side = math.ceil((5.0 * diameter_cm + margin_mm) / pixel_mm)
    inside = half_disc((2 * side, side), pixel_mm, 5.0 * diameter_cm)
    return body_paths(
        {"adipose": inside * 5.0 * thickness_cm, "gland": inside * 5.0 * thickness_cm},
        pixel_mm=pixel_mm,
        thickness_mm=10.0 * thickness_cm,
    )
