"""A local page to set up runs, watch them and look at their results: `mammosim serve`.

`form` knows the settings, `jobs` the runs in progress, and `results` what their folders hold.
`page` draws all of it with NiceGUI (extra `mammosim[serve]`), and `gate` admits only requests that
carry the address's token.
"""

from mammosim.serve.server import serve

__all__ = ["serve"]
