"""Reads YAML into settings and reports every mistake at once; knows no physics."""

from mammosim.config.keywords import documents_keys, given_settings
from mammosim.config.settings import Settings
from mammosim.config.validate import as_plain, settings_in, to_settings
from mammosim.config.yaml import parse_value, read_yaml, write_yaml

__all__ = [
    "Settings",
    "as_plain",
    "documents_keys",
    "given_settings",
    "parse_value",
    "read_yaml",
    "settings_in",
    "to_settings",
    "write_yaml",
]
