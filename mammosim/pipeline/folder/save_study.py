"""A study in memory, written as the run's folder that it would have been."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from mammosim.errors import InputError
from mammosim.pipeline.folder.lock import writing
from mammosim.pipeline.folder.run_folder import RunFolder
from mammosim.pipeline.study import Study


def save_study(study: Study, folder: str | PathLike[str], overwrite: bool = False) -> None:
    """Write a study as a run's folder; see `Study.save`.

    Parameters
    ----------
    study : Study
        With the configuration that it was made by.
    folder : str or path
        Made if it is not there.
    overwrite : bool
        Whether a folder that holds something may be written into.

    Raises
    ------
    InputError
        If the study has no configuration, the folder is not empty, another process writes into it,
        or a file cannot be written.

    Notes
    -----
    The files are those of `mammosim run`; nothing is computed again.
    """
    path = Path(folder)
    if study.config is None:
        raise InputError("save: the study has no configuration; simulate() gives it one")
    if path.is_dir() and any(path.iterdir()) and not overwrite:
        raise InputError(f"{path}: exists and is not empty; give overwrite=True or another folder")
    with writing(path):
        run = RunFolder(path, study.config)
        for breast in study.breasts:
            run.write_phantom(breast)
        for view in study.views.values():
            run.write_compression(view.compressed)
            run.write_view(view)
        converged = all(view.compressed.converged for view in study.views.values())
        run.write_summary(study, "done" if converged else "not converged")
