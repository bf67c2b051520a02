"""Settings of the targets."""

from __future__ import annotations

from mammosim.config import Settings


class TargetsSettings(Settings):
    """What is worked out about lesions and landmarks."""
