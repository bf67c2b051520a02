"""The command line: reads arguments, calls the pipeline, and is the only place that prints.

Exit status: 0 done, 2 bad input, 3 not converged or some patients failed, 130 interrupted.
"""

from mammosim.cli import runs, phantoms, locating, cohorts  # isort: skip  # in the help's order
from mammosim.cli.terminal import app, main

__all__ = ["app", "cohorts", "locating", "main", "phantoms", "runs"]
