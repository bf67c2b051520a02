"""A local page to set up runs, watch them and look at their results: `mammosim serve`.

`form` knows the settings, `jobs` the runs that are going on, `results` what lies in their folders;
`page` draws all of it with NiceGUI (extra `mammosim[serve]`), and `gate` lets in only who has the
address with its token.
"""

from mammosim.serve.server import serve

__all__ = ["serve"]
