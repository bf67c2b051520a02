"""The version, from the one place where it is written: `pyproject.toml`, as it was installed."""

from importlib.metadata import version

VERSION = version("mammosim")
