"""Run the command line: ``python -m mammosim``."""

from mammosim.cli import main

__all__ = ["main"]

if __name__ == "__main__":
    main()
