"""A run's folder: its files, its lock, and the stages kept in it."""

from mammosim.pipeline.folder.earlier_run import is_finished, read_record, title_of
from mammosim.pipeline.folder.lock import STAGES_FOLDER, is_being_written, writing
from mammosim.pipeline.folder.protection import refuse_own_configuration
from mammosim.pipeline.folder.run_folder import RunFolder
from mammosim.pipeline.folder.save_study import save_study
from mammosim.pipeline.folder.stage_cache import StageCache

__all__ = [
    "STAGES_FOLDER",
    "RunFolder",
    "StageCache",
    "is_being_written",
    "is_finished",
    "read_record",
    "refuse_own_configuration",
    "save_study",
    "title_of",
    "writing",
]
