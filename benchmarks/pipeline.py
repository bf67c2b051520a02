"""Whole runs as a user starts them: wall time and peak memory of a configuration, stage by stage.

    python benchmarks/pipeline.py CONFIG [--set section.key=value ...]

Runs the command line twice in processes of their own (the second with all code compiled) into a
temporary folder and prints what run.json says of each.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def main() -> None:
    """Run the configuration given on the command line twice."""
    arguments = sys.argv[1:]
    for number in ("first", "second"):
        with tempfile.TemporaryDirectory() as folder:
            output = Path(folder) / "run"
            start = time.perf_counter()
            subprocess.run(
                [sys.executable, "-m", "mammosim", "run", *arguments, "--output", str(output)],
                check=True,
            )
            seconds = time.perf_counter() - start
            record = json.loads((output / "run.json").read_text())
        print(f"{number}: {seconds:.1f} s, status {record['status']}")
        for stage, spent in record["stage_seconds"].items():
            print(f"  {stage:20} {spent:7.2f} s")
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    print(f"peak memory: {peak / 1024:.0f} MiB")


if __name__ == "__main__":
    main()
