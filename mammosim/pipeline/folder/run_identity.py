"""What makes a run that run: hashes of its input files, and the hash of all that decides it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mammosim._version import VERSION
from mammosim.phantom import open_voxels, shape_files
from mammosim.pipeline.configuration import RunConfig, input_paths, without_paths
from mammosim.report import file_hash, run_hash


@dataclass(frozen=True)
class InputHashes:
    """Hashes of the files that a configuration names, and of those that they consist of."""

    labels: tuple[str, ...]
    others: tuple[str, ...]
    voxels: tuple[str, ...]
    lesions: tuple[str, ...]

    @classmethod
    def of(cls, config: RunConfig) -> InputHashes:
        """Read all files once."""
        named = [(where, Path(path)) for where, path in input_paths(config)]
        files = [(where, path) for where, path in named if _is_file(path)]
        labels = [path for where, path in files if where == ("phantom", "labels")]
        others = [path for where, path in files if where[0] != "phantom"]
        phantoms = [str(one.phantom.file) for one in config.sides if one.phantom.file is not None]
        voxels = [path for phantom in phantoms for path in open_voxels(phantom).files]
        shapes = [path for where, path in files if where[:2] == ("phantom", "lesions")]
        lesions = [path for shape in shapes for path in shape_files(shape)]
        parts = (labels, others, voxels, lesions)
        hashes = [tuple(file_hash(path) for path in part) for part in parts]
        return cls(*hashes)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:
        return False  # no name that the system knows: said when the file is read


def hash_of(config: RunConfig, inputs: InputHashes) -> str:
    """Hash of everything that decides a run's result."""
    files = (*inputs.labels, *inputs.others, *inputs.voxels, *inputs.lesions)
    return run_hash(without_paths(config), config.seed, VERSION, files)
