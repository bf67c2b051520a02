"""Files for libraries that believe a header's lengths before they look at the file's."""

from __future__ import annotations

import io
from pathlib import Path


class BoundedFile(io.BufferedReader):
    """A file that never makes room for more bytes than it still holds.

    Python's own `read(n)` takes n bytes of memory before it finds that there are fewer: one
    changed byte of a length in a header would be gigabytes.

    Parameters
    ----------
    path : path
    """

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self._length = path.stat().st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """As much as is asked for, but no more than is left."""
        if size is not None and size >= 0:
            size = min(size, max(self._length - self.tell(), 0))
        return super().read(size)
