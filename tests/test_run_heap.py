"""Memory that one array has left is taken by the next, whatever the environment says."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

ALLOCATE = """
import resource
import numpy as np
from mammosim.pipeline import keep_freed_memory, return_freed_memory

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(50):
        np.ones(1 << 20, np.uint8)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

print(faults(), keep_freed_memory(), faults())
return_freed_memory()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the C library of Linux")
def test_freed_pages_are_used_again():
    """Also where they are to be returned at once, as Dask's nanny tells its workers."""
    environment = {**os.environ, "MALLOC_TRIM_THRESHOLD_": "65536"}
    done = subprocess.run(
        [sys.executable, "-c", ALLOCATE], env=environment, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    before, kept, after = done.stdout.split()
    if kept == "False":
        pytest.skip("not glibc")
    assert int(before) > 50 * (1 << 20) // 8192  # at least half of the pages of each array
    assert int(after) < int(before) // 10
