"""What an earlier run left in a folder: its record, whether it is whole, and how it is removed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mammosim.config import folder_name, read_text, real_path
from mammosim.errors import InputError
from mammosim.export import PART_PREFIX
from mammosim.pipeline.configuration import RunConfig
from mammosim.pipeline.folder.run_identity import InputHashes, hash_of
from mammosim.report import NOT_HASHED, file_hash


def is_finished(path: Path, config: RunConfig) -> bool:
    """Whether a folder holds the finished run of this very configuration, all files unharmed.

    Parameters
    ----------
    path : Path
        A run's folder.
    config : RunConfig

    Returns
    -------
    bool
        True if the record says so, its settings and the hash over settings and input files are the
        same, and every file that it lists still has its content.
    """
    record = read_record(path)
    if record.get("status") != "done" or record.get("settings") != config.plain():
        return False
    if record.get("run_hash") != hash_of(config, InputHashes.of(config)):
        return False
    hashes = record.get("files")
    return isinstance(hashes, dict) and all(
        _is_unharmed(path, name, wanted) for name, wanted in hashes.items()
    )


def read_record(path: Path) -> dict[str, Any]:
    """What a folder's `run.json` says.

    Parameters
    ----------
    path : Path
        Folder of a run.

    Returns
    -------
    dict
        The record by its keys (docs/reference/outputs.md); empty where there is none that can be
        read. Its values are not checked.
    """
    try:
        record = json.loads(read_text(path / "run.json"))
    except (OSError, ValueError, RecursionError):
        return {}
    return record if isinstance(record, dict) else {}


def _is_unharmed(folder: Path, name: str, wanted: Any) -> bool:
    file = folder / name
    try:
        return real_path(file).is_relative_to(real_path(folder)) and file_hash(file) == wanted
    except (OSError, ValueError):
        return False


def title_of(path: Path) -> str:
    """What a run of this configuration is called.

    Parameters
    ----------
    path : Path
        Configuration file, or the `run.json` of an earlier run.

    Returns
    -------
    str
        The file's name without its ending; of a `run.json`, the title of the run it records.
    """
    if path.suffix == ".json":
        title = read_record(path.parent).get("title") if path.name == "run.json" else None
        return folder_name(title, path.stem)
    return path.stem


def remove_earlier_run(folder: Path) -> None:
    """Remove what an earlier run left, its record first, so that no record outlives its files."""
    record = read_record(folder)
    hashes = record.get("files")
    try:
        for name in NOT_HASHED:
            (folder / name).unlink(missing_ok=True)
        for name, wanted in hashes.items() if isinstance(hashes, dict) else ():
            if _is_unharmed(folder, name, wanted):
                (folder / name).unlink()
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror})") from None


def remove_unfinished_files(folder: Path) -> None:
    """Remove what a run that was killed left half written, while nothing is written there."""
    try:
        for part in folder.rglob(f"{PART_PREFIX}*"):
            if part.is_file():
                part.unlink()
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror})") from None
