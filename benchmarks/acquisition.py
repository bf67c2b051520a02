"""Make the figures of docs/explanation/acquisition.md, measured from simulated pictures.

python benchmarks/acquisition.py docs/images/acquisition

The scenes and measurements are those of tests/test_acquisition_measured.py; a minute on two cores.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import test_acquisition_measured as measured
from naive.acquisition import boone_ratio, disc_paths, edge_paths, slab_paths
from test_acquisition_scatter import upright_semicircle

import mammosim
from mammosim.acquisition import DETECTORS, expose_arc
from mammosim.acquisition.attenuation import BEAM_MATERIALS, attenuation_per_mm
from mammosim.acquisition.heel import heel_ratio
from mammosim.acquisition.noise import noise_through_blur
from mammosim.acquisition.quality import detective_efficiency, edge_mtf
from mammosim.acquisition.scatter import SCATTER_MODELS
from mammosim.acquisition.spectrum import make_beam
from mammosim.projection import project_arc

COLOURS = {"a-Se-70": "#3b82c4", "a-Se-85": "#4f9a5b", "CsI-100": "#c2742d"}
GUIDELINE_HVL = {("Mo", "Mo"): (0.36, 0.02), ("Mo", "Rh"): (0.42, 0.02), ("Rh", "Rh"): (0.43, 0.02),
                 ("W", "Rh"): (0.54, 0.03)}  # mm Al at 28 kV, European guidelines 2006  # fmt: skip


def main() -> None:
    """Draw every figure into the folder given on the command line."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    style = {"font.size": 9, "axes.spines.top": False, "axes.spines.right": False,
             "legend.frameon": False, "axes.grid": True, "grid.alpha": 0.2}  # fmt: skip
    figures = (beam, sharpness, efficiency, variance, scatter, contrast, tomosynthesis)
    with mpl.rc_context(style):
        for draw in figures:
            figure = draw()
            figure.savefig(folder / f"{draw.__name__}.png", dpi=130)
            print(f"wrote {folder / draw.__name__}.png")


def _figure(columns: int, width: float = 9.0, height: float = 3.4) -> tuple[Figure, list]:
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, list(np.atleast_1d(figure.subplots(1, columns)))


def beam() -> Figure:
    """Spectra, kerma behind aluminium, and the heel effect."""
    figure, (spectra, layers, heel) = _figure(3, 10.5)
    sheet = np.linspace(0.0, 0.8, 81)
    for pair, (typical, tolerance) in GUIDELINE_HVL.items():
        one = make_beam(*pair, 28.0)
        fluence = one.fluence_mm2_mas / one.fluence_mm2_mas.sum() / 0.25
        (line,) = spectra.plot(one.energy_kev, fluence, label="/".join(pair), linewidth=1)
        mu = attenuation_per_mm(BEAM_MATERIALS["Al"], one.energy_kev)
        kerma = one._kerma_weights() * one.fluence_mm2_mas
        left = np.exp(-np.outer(sheet, mu)) @ kerma / kerma.sum()
        layers.semilogy(sheet, left, color=line.get_color(), linewidth=1)
        found = float(np.interp(-np.log(0.5), -np.log(left), sheet))
        layers.errorbar(typical, 0.5, xerr=tolerance, fmt="o", capsize=3, markersize=3,
                        color=line.get_color())  # fmt: skip
        print(f"HVL {'/'.join(pair)} 28 kV: {found:.3f} mm Al, typical {typical} +- {tolerance}")
    spectra.set(xlabel="energy, keV", ylabel="share of photons, 1/keV", xlim=(8, 29))
    spectra.legend()
    layers.axhline(0.5, color="black", linewidth=0.5)
    layers.set(xlabel="aluminium, mm", ylabel="air kerma left")
    layers.set_yticks([0.3, 0.5, 1.0], ["0.3", "0.5", "1"])
    layers.minorticks_off()
    one, x = make_beam("W", "Rh", 28.0), np.arange(0.0, 241.0, 2.0)
    ratio = heel_ratio("W", 28.0, one.energy_kev, x / 650.0)
    kerma = one._kerma_weights() * one.fluence_mm2_mas
    heel.plot(x, ratio @ kerma / kerma.sum(), label="air kerma")
    mean = (ratio * kerma) @ one.energy_kev / (ratio @ kerma)
    heel.plot(x, mean / np.interp(68.3, x, mean), label="mean energy of it")
    heel.set(xlabel="distance from the chest wall, mm", ylabel="against the tube's axis")
    heel.legend()
    return figure


def sharpness() -> Figure:
    """MTF from slanted edges, and what the focal spot takes at each height."""
    figure, (axes, spot) = _figure(2)
    for name, detector in DETECTORS.items():
        pixel = measured.PIXEL_MM[name]
        taken = measured.take(edge_paths(pixel), 100.0, detector=name, focal_spot_mm=0.0)
        frequency, found = edge_mtf(taken.picture[measured.MARGIN], pixel)
        axes.plot(frequency, measured.model_mtf(name, frequency, 0.0), color=COLOURS[name])
        axes.plot(frequency[::3], found[::3], ".", color=COLOURS[name], markersize=5,
                  label=f"{detector.name}: measured")  # fmt: skip
    axes.plot([2, 4, 5], [0.73, 0.42, 0.28], "x", color="black", label="CsI, Vedantham 2000")
    axes.set(xlabel="frequency, 1/mm", ylabel="MTF", ylim=(0, 1.02), xlim=(0, None))
    axes.legend()
    gantry = edge_paths(0.07).gantry
    frequency = np.linspace(0.0, 10.0, 101)
    for height, label in ((0.0, "at the support"), (25.0, "mid-height"), (50.0, "at the paddle")):
        width = measured.spot_width_mm(0.3, gantry, height)
        spot.plot(frequency, np.sinc(width * frequency), label=f"{label}: {1e3 * width:.0f} µm")
    spot.set(xlabel="frequency, 1/mm", ylabel="MTF of a 0.3 mm focal spot", ylim=(0.7, 1.005))
    spot.legend(title="breast of 50 mm, shadow of the spot")
    return figure


def efficiency() -> Figure:
    """NNPS and DQE against the model, and DQE against exposure beside published values."""
    figure, (noise, dqe, exposure) = _figure(3, 10.5)
    for name, model in DETECTORS.items():
        mas, pixel = 40.0, measured.PIXEL_MM[name]
        frequency, nnps, taken = measured.flat_noise(name, mas)
        mean, blur2 = taken.picture.mean(), model.transfer(frequency) ** 2
        expected = taken.energy_kev * mean * blur2 + model.electronic_noise_kev**2
        expected = (expected + (model.structure_noise * mean) ** 2) * pixel**2 / mean**2
        noise.semilogy(frequency, nnps, ".", color=COLOURS[name], markersize=2, label=name)
        noise.semilogy(frequency, expected, color=COLOURS[name], linewidth=1)
        edge = measured.take(edge_paths(pixel), mas, detector=name, noise=False, focal_spot_mm=0.0)
        mtf = np.interp(frequency, *edge_mtf(edge.picture[measured.MARGIN], pixel))
        photons = measured.photons_per_mm2(taken.incident, mas)
        found = detective_efficiency(mtf, nnps, photons)
        whole = measured.model_mtf(name, frequency, 0.0)
        dqe.plot(frequency, found, ".", color=COLOURS[name], markersize=2, label=name)
        dqe.plot(frequency, detective_efficiency(whole, expected, photons), color=COLOURS[name])
    noise.set(xlabel="frequency, 1/mm", ylabel="NNPS, mm²")
    noise.legend(markerscale=4)
    dqe.set(xlabel="frequency, 1/mm", ylabel="DQE", ylim=(0, 1))
    levels = np.array([0.4, 1.3, 6.0, 32.8])
    with tempfile.TemporaryDirectory() as folder:
        for name in ("a-Se-85", "CsI-100"):
            found = [measured.published_dqe(Path(folder), name, level) for level in levels]
            exposure.semilogx(levels, found, "o-", color=COLOURS[name], label=name, markersize=4)
            print(f"DQE {name} at {levels} mR: {np.round(found, 3)}")
            if name == "a-Se-85":
                exposure.plot(0.4, 0.8 * found[2], "x", color="black",
                              label="a fifth below 6 mR, Zhao 2008")  # fmt: skip
    exposure.plot([1.3, 32.8], [0.40, 0.55], "+", color="black", label="CsI, Vedantham 2000")
    exposure.set(xlabel="exposure, mR (Mo/Mo 28 kV, 45 mm Lucite)", ylabel="DQE, 0.1–1.2 1/mm",
                 ylim=(0, 1))  # fmt: skip
    exposure.legend()
    return figure


def variance() -> Figure:
    """Variance against exposure, and its three parts."""
    figure, panels = _figure(2)
    for axes, name in zip(panels, ("a-Se-70", "CsI-100"), strict=True):
        pixel, model = measured.PIXEL_MM[name], DETECTORS[name]
        loads = np.geomspace(0.1, 1000.0, 9)
        means, found = [], []
        for number, mas in enumerate(loads):
            paths = slab_paths(pixel, measured.FLAT_MM, size=300)
            taken = measured.take(paths, mas, seed=number, detector=name)
            inner = taken.picture[20:-20, 20:-20]
            means.append(inner.mean())
            found.append(measured.variance_without_trend(inner))
        means = np.array(means)
        quantum = taken.energy_kev * means * noise_through_blur(model, pixel)
        structure = (model.structure_noise * means) ** 2
        electronic = np.full_like(means, model.electronic_noise_kev**2)
        axes.loglog(means, found, "o", color="black", markersize=4, label="measured")
        for part, label in ((quantum, "quantum"), (electronic, "electronic"),
                            (structure, "fixed pattern")):  # fmt: skip
            axes.loglog(means, part, linewidth=1, label=label)
        axes.loglog(means, quantum + electronic + structure, color="black", linewidth=0.7)
        axes.set(xlabel="mean, keV a pixel", ylabel="variance, keV²", title=name)
        axes.legend()
    return figure


def scatter() -> Figure:
    """Model `kernels`: slabs beside Monte Carlo and Boone's formula, and a slab's profile."""
    figure, (slabs, profile) = _figure(2, 9.5, 3.8)
    thicknesses = np.array([20.0, 40.0, 60.0, 80.0])
    for plates, colour in ((False, "#3b82c4"), (True, "#c2742d")):
        found = []
        for thickness in thicknesses:
            case = upright_semicircle(thickness, plates)
            signal = SCATTER_MODELS["kernels"](case).signal
            middle, at = signal.shape[0] // 2, int(34.0 / case.cell_mm)
            inside = (slice(middle - 5, middle + 5), slice(at - 5, at + 5))
            found.append(signal[inside].sum() / case.primary[inside].sum())
            if thickness == 60.0:
                x = (np.arange(signal.shape[1]) + 0.5) * case.cell_mm
                profile.plot(x, signal[middle] / case.primary[middle], color=colour)
        label = "between plates" if plates else "bare"
        slabs.plot(thicknesses, found, color=colour, label=f"kernels, {label}")
        print("kernels,", label, np.round(found, 3))
    slabs.plot(
        thicknesses, [0.234, 0.441, 0.637, 0.825], "o", color="#3b82c4", label="MC-GPU, bare"
    )
    slabs.plot(thicknesses[1:3], [0.510, 0.725], "s", color="#c2742d", label="MC-GPU, plates")
    slabs.plot(
        thicknesses, [boone_ratio(16.0, t / 10.0) for t in thicknesses], ":", color="black",
        label="Boone 2000",
    )  # fmt: skip
    slabs.set(xlabel="thickness, mm", ylabel="scatter over primary", title="centre of mass")
    slabs.legend(fontsize=7)
    profile.set(xlabel="distance from the chest wall, mm", ylabel="scatter over primary",
                title="60 mm, across the edge at 82 to 91 mm")  # fmt: skip
    return figure


def contrast() -> Figure:
    """A disc of 4 mm gland in 50 mm of fat: its pictures, and signal difference to noise."""
    figure, (low, high, axes) = _figure(3, 9.5)
    paths = disc_paths(0.1)
    at = (np.arange(400) + 0.5 - 200) * 0.1
    radius = np.hypot(at[:, None], at[None, :])
    disc, around = radius < 6.5, (radius > 9.5) & (radius < 14.0)
    loads, found = np.array([6.25, 12.5, 25.0, 50.0, 100.0, 200.0]), []
    for mas in loads:
        picture = measured.take(paths, mas).picture
        found.append((picture[around].mean() - picture[disc].mean()) / picture[around].std())
        for panel, shown in ((low, 6.25), (high, 100.0)):
            if mas == shown:
                level = picture[around].mean()
                panel.imshow(picture, cmap="gray_r", vmin=0.8 * level, vmax=1.1 * level)
                panel.set_title(f"{mas:g} mAs: SDNR {found[-1]:.1f}")
                panel.set_axis_off()
    axes.loglog(loads, found, "o", color="black", label="measured")
    axes.loglog(loads, found[-2] * np.sqrt(loads / 100.0), linewidth=1, label="square root of load")
    axes.set(xlabel="tube load, mAs", ylabel="signal difference to noise")
    axes.set_yticks([3, 5, 10], ["3", "5", "10"])
    axes.set_yticks([], minor=True)
    axes.legend()
    print("SDNR", dict(zip(loads.tolist(), np.round(found, 2).tolist(), strict=True)))
    return figure


def tomosynthesis() -> Figure:
    """Five of the projections of a generated breast, as the logarithm of the signal."""
    breast = mammosim.generate_phantom(density="scattered", voxel_mm=0.5, seed=1, volume_ml=400)
    compressed = mammosim.compress(breast, "CC", model="springs", resolution_mm=2.0)
    arc = project_arc(compressed, {"angle_range_deg": 50.0, "projections": 5}, pixel_mm=0.2)
    series = expose_arc(arc, mas=90.0)
    figure = Figure(figsize=(10.5, 3.6), layout="constrained")
    panels = figure.subplots(1, 5)
    for axes, picture, gantry in zip(panels, series.projections, series.gantries, strict=True):
        counts = np.maximum(picture[150:1050, :560].astype(np.float64), 1.0)
        axes.imshow(np.log(counts.max() / counts), cmap="gray", vmin=0.0, vmax=3.4)
        axes.set_title(f"{gantry.tube_angle_deg:+.1f}°".replace("+0.0", "0"))
        axes.set_axis_off()
    return figure


if __name__ == "__main__":
    main()
