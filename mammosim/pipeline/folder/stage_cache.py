"""Stages that are kept: results in a run's folder by the hash of all that they depend on.

Kept are the two stages that cost: a generated breast, and each view's compression. Projecting and
exposing take seconds, and their results hundreds of megabytes.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray

from mammosim._version import VERSION
from mammosim.compression import CompressedBreast, CompressionSettings
from mammosim.config import open_file, read_text
from mammosim.errors import InputError
from mammosim.export import whole_file, write_json
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom, as_held
from mammosim.pipeline.configuration import RunConfig, without_paths
from mammosim.pipeline.folder.lock import STAGES_FOLDER
from mammosim.pipeline.folder.serialization import pack, unpack
from mammosim.report import file_hash

PHANTOM_ROOMS = ("config", "geometry", "phantom", "tissues")
COMPRESSION_ROOMS = (*PHANTOM_ROOMS, "compression")
PACKAGES = ("numpy", "numba", "scipy")
"""Rooms whose source, and distributions whose version, decide a stage's result."""

COMPRESSION_LEVEL = 1
"""ISA-L's level for kept stages. Labels of 213 million voxels take 0.29 s and 14.8 MB with it,
0.85 s and 16.4 MB with zlib's own level 1."""

HandOver = Callable[..., Any]
"""Called with a function that writes and what it is called with, then or later."""


class StageCache:
    """Results of stages in one or more runs' folders.

    Parameters
    ----------
    run : path
        The run's folder, where results are written.
    inputs : sequence of str
        Hashes of the phantom's files.
    others : iterable of path
        Folders of other runs, whose results are read where they fit and never changed.

    Attributes
    ----------
    reused : list of str
        Stages that did not have to be computed, as ``LCC.compression``; phantoms first.
    """

    def __init__(self, run: Path, inputs: Iterable[str], others: Iterable[Path] = ()) -> None:
        self._folders = [folder / STAGES_FOLDER for folder in (run, *others)]
        self._inputs = tuple(inputs)
        self._reused: list[str] = []

    @property
    def reused(self) -> list[str]:
        """Phantoms, then compressions, whichever thread found them first."""
        return sorted(self._reused, key=lambda name: (not name.endswith("phantom"), name))

    def make_folder(self) -> None:
        """Make the folder of kept stages, which also marks its parent as a run's.

        Raises
        ------
        InputError
            If it cannot be made.
        """
        try:
            self._folders[0].mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{self._folders[0]}: cannot be written ({error.strerror})") from None

    def phantom(
        self, config: RunConfig, make: Callable[[], BreastPhantom], hand_over: HandOver
    ) -> BreastPhantom:
        """The uncompressed breast; one from a file is read again, which is as fast.

        The configuration is that of this breast alone; `hand_over` has a result written.
        """
        if config.phantom.generate is None:
            return make()
        key = stage_key(PHANTOM_ROOMS, _phantom_values(config), self._inputs)
        name = f"{config.laterality}.phantom" if config.breast_number else "phantom"
        breast: BreastPhantom = self._kept(name, key, make, hand_over)
        return breast

    def compression(
        self,
        config: RunConfig,
        settings: CompressionSettings,
        breast: BreastPhantom,
        view: View,
        make: Callable[[], CompressedBreast],
        hand_over: HandOver,
    ) -> CompressedBreast:
        """A view's compressed breast, kept if it converged."""
        values = {
            **_phantom_values(config),
            "view": [view.name, view.laterality, view.mlo_angle_deg, view.tomosynthesis],
            "compression": settings.model_dump(mode="json"),
        }
        key = stage_key(COMPRESSION_ROOMS, values, self._inputs)
        # The breast has its own file, or is in the phantom's.
        compressed: CompressedBreast = self._kept(
            f"{view.folder}.compression", key, make, hand_over,
            lambda made: replace(made, phantom=None),
        )  # fmt: skip
        if compressed.phantom is None:
            compressed = replace(compressed, phantom=as_held(breast, view.rotation[1]))
        return compressed

    def _kept(
        self,
        name: str,
        key: str,
        make: Callable[[], Any],
        hand_over: HandOver,
        before_saving: Callable[[Any], Any] = lambda made: made,
    ) -> Any:
        for folder in self._folders:
            found = _load(folder / f"{name}.npz", key)
            if found is not None:
                self._reused.append(name)
                return found
        made = make()
        hand_over(_save, self._folders[0], name, key, before_saving(made))
        return made


def stage_key(rooms: Iterable[str], values: Any, inputs: Iterable[str]) -> str:
    """Hash of what a stage's result depends on.

    Parameters
    ----------
    rooms : iterable of str
        Rooms of the package whose code makes it.
    values : object
        Settings as plain values.
    inputs : iterable of str
        Hashes of the files that it reads.

    Returns
    -------
    str
        SHA-256, 64 hexadecimal digits.
    """
    decides = {
        "code": _code_hash(tuple(rooms)),
        "versions": {"mammosim": VERSION, **{package: version(package) for package in PACKAGES}},
        "values": values,
        "inputs": list(inputs),
    }
    text = json.dumps(decides, sort_keys=True, separators=(",", ":"), default=str)
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


@cache
def _code_hash(rooms: tuple[str, ...]) -> str:
    """Hash of the source and tables of some rooms, so that no result outlives its code."""
    digest = hashlib.sha256()
    package = Path(str(files("mammosim")))
    for place in [package / "_jit.py", *(package / room for room in rooms)]:
        found = [place] if place.is_file() else sorted(place.rglob("*"))
        for path in found:
            if path.suffix in (".py", ".yaml"):
                digest.update(path.relative_to(package).as_posix().encode() + b"\0")
                digest.update(path.read_bytes())
    return digest.hexdigest()


def _phantom_values(config: RunConfig) -> dict[str, Any]:
    """What decides one breast's phantom, whether or not it is part of an exam of both."""
    values = without_paths(config)
    second = {"breast_number": config.breast_number} if config.breast_number else {}
    return {**{key: values.get(key) for key in ("phantom", "laterality", "seed")}, **second}


def _save(folder: Path, name: str, key: str, record: Any) -> None:
    arrays: dict[str, Any] = {}
    packed = json.dumps(pack(record, arrays))
    path = folder / f"{name}.npz"
    with whole_file(path) as part:
        _write_arrays(part, {"record": np.array(packed), **arrays})
    write_json(folder / f"{name}.json", {"key": key, "sha256": file_hash(path)})


def _write_arrays(path: Path, arrays: dict[str, NDArray[Any]]) -> None:
    """Write what `np.savez_compressed` would, compressed by ISA-L, in a third of the time."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, values in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:
                # `zipfile` knows only zlib's compressor; ISA-L's has the same methods.
                stream._compressor = isal_zlib.compressobj(  # type: ignore[attr-defined]
                    COMPRESSION_LEVEL, wbits=-isal_zlib.MAX_WBITS
                )
                np.lib.format.write_array(stream, values, allow_pickle=False)


def _load(path: Path, key: str) -> Any:
    """What is kept under this key; None where nothing whole is."""
    try:
        note = json.loads(read_text(path.with_suffix(".json")))
        if not isinstance(note, dict) or note.get("key") != key:
            return None
        if note.get("sha256") != file_hash(path):
            return None
        with open_file(path) as stream, np.load(stream, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        return unpack(json.loads(str(arrays.pop("record"))), arrays)
    except (OSError, ValueError, KeyError, TypeError, RecursionError, zipfile.BadZipFile):
        return None  # damaged or of another kind: it is computed again
