"""Synthetic mammograms from labelled voxel breasts, and where each lesion went.

The stages can be called one by one::

    breast = mammosim.generate_phantom(density="scattered", voxel_mm=0.5, seed=1)
    compressed = mammosim.compress(breast, view="CC", thickness_mm=50.0)
    paths = mammosim.project(compressed, pixel_mm=0.1)
    image = mammosim.expose(paths, seed=1)

or all at once from a configuration::

    study = mammosim.simulate(mammosim.load_config("quickstart.yaml"))
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from mammosim._display import register_displays
from mammosim._version import VERSION

if TYPE_CHECKING:
    from mammosim.acquisition import (
        AcquisitionSettings,
        Mammogram,
        Tomosynthesis,
        expose,
        expose_arc,
    )
    from mammosim.compression import CompressedBreast, CompressionSettings, compress
    from mammosim.errors import InputError, Interrupted, MammosimError, NotConverged
    from mammosim.export import load_path_lengths
    from mammosim.phantom import (
        BreastPhantom,
        GenerateSettings,
        generate_phantom,
        read_phantom,
    )
    from mammosim.pipeline import RunConfig, Study, load_config, simulate
    from mammosim.projection import (
        PathLengths,
        ProjectionSettings,
        TomosynthesisSettings,
        project,
        project_arc,
    )
    from mammosim.reconstruction import Reconstruction, ReconstructionSettings, reconstruct
    from mammosim.targets import Target, find_targets

__version__ = VERSION

_HOMES = {
    "acquisition": ("AcquisitionSettings", "Mammogram", "Tomosynthesis", "expose", "expose_arc"),
    "compression": ("CompressedBreast", "CompressionSettings", "compress"),
    "errors": ("InputError", "Interrupted", "MammosimError", "NotConverged"),
    "export": ("load_path_lengths",),
    "phantom": ("BreastPhantom", "GenerateSettings", "generate_phantom", "read_phantom"),
    "pipeline": ("RunConfig", "Study", "load_config", "simulate"),
    "projection": (
        "PathLengths",
        "ProjectionSettings",
        "TomosynthesisSettings",
        "project",
        "project_arc",
    ),
    "reconstruction": ("Reconstruction", "ReconstructionSettings", "reconstruct"),
    "targets": ("Target", "find_targets"),
}
register_displays(
    {
        "BreastPhantom.html": "mammosim.report:breast_html",
        "BreastPhantom.plot": "mammosim.report:plot_breast",
        "CompressedBreast.html": "mammosim.report:compressed_html",
        "CompressedBreast.plot": "mammosim.report:plot_compressed",
        "Mammogram.html": "mammosim.report:mammogram_html",
        "Mammogram.plot": "mammosim.report:plot_mammogram",
        "Mammogram.save": "mammosim.export:save_mammogram",
        "Study.html": "mammosim.report:study_html",
        "Study.plot": "mammosim.report:plot_study",
        "Study.save": "mammosim.pipeline:save_study",
    }
)
_HOME_OF = {name: room for room, names in _HOMES.items() for name in names}

__all__ = [
    "AcquisitionSettings",
    "BreastPhantom",
    "CompressedBreast",
    "CompressionSettings",
    "GenerateSettings",
    "InputError",
    "Interrupted",
    "Mammogram",
    "MammosimError",
    "NotConverged",
    "PathLengths",
    "ProjectionSettings",
    "Reconstruction",
    "ReconstructionSettings",
    "RunConfig",
    "Study",
    "Target",
    "Tomosynthesis",
    "TomosynthesisSettings",
    "compress",
    "expose",
    "expose_arc",
    "find_targets",
    "generate_phantom",
    "load_config",
    "load_path_lengths",
    "project",
    "project_arc",
    "read_phantom",
    "reconstruct",
    "simulate",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that the command line starts at once."""
    if name not in _HOME_OF:
        raise AttributeError(f"module 'mammosim' has no attribute '{name}'")
    value = getattr(importlib.import_module(f"mammosim.{_HOME_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Public names."""
    return [*__all__, "__version__"]
