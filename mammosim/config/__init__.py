"""Reads YAML into settings and reports every mistake at once; knows no physics."""

from mammosim.config.files import open_file, read_text, real_path, user_path, utf8_path
from mammosim.config.keywords import documents_keys, given_settings
from mammosim.config.quantities import (
    MAX_FORCE_N,
    MAX_LENGTH_MM,
    Coordinate,
    Name,
    Position,
    folder_name,
)
from mammosim.config.settings import Settings
from mammosim.config.validate import as_plain, settings_in, to_settings
from mammosim.config.yaml import parse_value, read_yaml, write_yaml

__all__ = [
    "MAX_FORCE_N",
    "MAX_LENGTH_MM",
    "Coordinate",
    "Name",
    "Position",
    "Settings",
    "as_plain",
    "documents_keys",
    "folder_name",
    "given_settings",
    "open_file",
    "parse_value",
    "read_text",
    "read_yaml",
    "real_path",
    "settings_in",
    "to_settings",
    "user_path",
    "utf8_path",
    "write_yaml",
]
