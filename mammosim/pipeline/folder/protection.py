"""What a run leaves alone in its folder: links, files that it reads, and files of others."""

from __future__ import annotations

import os
import re
from pathlib import Path

from mammosim.config import real_path
from mammosim.errors import InputError
from mammosim.pipeline.configuration import RunConfig, input_paths
from mammosim.pipeline.folder.earlier_run import read_record
from mammosim.pipeline.folder.lock import STAGES_FOLDER

OWN_FILES = frozenset(
    {"config.yaml", "run.json", "report.html", "lesions.csv", "view_rules.csv", "biopsy.csv",
     "uncertainty.csv", "uncompressed.nii.gz", "labels.json", "labels.ctbl",
     "uncompressed.seg.nrrd", "labels_itksnap.txt", "lesions.mrk.json"}
)  # fmt: skip
"""Files that a run writes at the top of its folder."""

VIEW_FOLDER = re.compile(r"[LR](CC|MLO|ML)(_\w+)?")
"""Folders that a run writes files into, in addition to those of named views."""


def refuse_links(folder: Path) -> None:
    """Refuse links in a run's folder: what is written must stay in it.

    The folder itself may be a link.

    Raises
    ------
    InputError
        Naming the first link.
    """
    for parent, folders, files in os.walk(folder, followlinks=False):
        for name in sorted([*folders, *files]):
            path = Path(parent, name)
            own = path.parent == folder and (name == STAGES_FOLDER or VIEW_FOLDER.fullmatch(name))
            if path.is_symlink() and (name in folders or own):
                raise InputError(
                    f"{path}: is a link to {os.readlink(path)}; a run does not write through "
                    f"links in its folder; remove it, or choose another output folder"
                )


def refuse_inputs_within(folder: Path, config: RunConfig) -> None:
    """Refuse a run that reads a file from the folder that it writes.

    Raises
    ------
    InputError
        Naming the key and the file.
    """
    home = real_path(folder)
    for where, value in input_paths(config):
        if real_path(value).is_relative_to(home):
            key = ".".join(str(part) for part in where)
            raise InputError(
                f"{key}: {value} lies in the output folder {folder}, whose files are replaced; "
                "copy it elsewhere, or choose another output folder"
            )


def refuse_strangers(folder: Path, config: RunConfig) -> None:
    """Refuse a folder with a run's file names that no run wrote, or files named as its folders.

    Other files may lie there; they are left alone.

    Parameters
    ----------
    folder : Path
    config : RunConfig
        The run that is to be written there.

    Raises
    ------
    InputError
        Naming the first file.
    """
    if not folder.is_dir():
        return
    for path in sorted(folder.iterdir()):
        if not path.is_dir() and (path.name == STAGES_FOLDER or _is_views(path.name, config)):
            raise InputError(
                f"{path}: is a file where this run makes a folder; move it away, or choose another "
                "output folder"
            )
    if _is_runs(folder):
        return
    for path in sorted(folder.iterdir()):
        if path.name in OWN_FILES:
            stranger = path
        elif _is_views(path.name, config) and path.is_dir() and any(path.iterdir()):
            stranger = next(path.iterdir())
        else:
            continue
        raise InputError(
            f"{stranger}: would be replaced, but {folder} is not the folder of a run; "
            "move it away, or choose another output folder"
        )


def _is_views(name: str, config: RunConfig) -> bool:
    own = {f"{side}{view.label}" for side in "LR" for view in config.views} | {"L", "R"}
    return name in own or VIEW_FOLDER.fullmatch(name) is not None


def _is_runs(folder: Path) -> bool:
    return bool(read_record(folder).get("run_hash")) or (folder / STAGES_FOLDER).is_dir()


def refuse_own_configuration(folder: Path, config: Path) -> None:
    """Refuse to replace the file from which the configuration was read.

    Raises
    ------
    InputError
        Naming the file.
    """
    for name in ("config.yaml", "run.json"):
        if config.exists() and (folder / name).exists() and config.samefile(folder / name):
            raise InputError(
                f"{config}: is read by this run, which would replace it; copy it elsewhere, or "
                "choose another output folder"
            )
