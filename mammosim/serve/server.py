"""Starts the page on the loopback address."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from mammosim.errors import InputError
from mammosim.serve.jobs import Command

ADDRESS = "127.0.0.1"
"""Loopback: no other machine can reach the page."""


def serve(
    port: int, examples: Path, runs: Path, command: Command, say: Callable[[str], None]
) -> None:
    """Serve the page until it is interrupted.

    Parameters
    ----------
    port : int
    examples : Path
        Folder of example configurations.
    runs : Path
        Folder of runs, where new ones are made too.
    command : callable
        See `Jobs`.
    say : callable
        Called with the page's address.

    Raises
    ------
    InputError
        If the library of the page is not installed.
    """
    try:
        from nicegui import app, ui
    except ImportError:
        raise InputError(
            "serve: NiceGUI is not installed; install it with: pip install nicegui"
        ) from None
    from mammosim.serve.gate import Gate
    from mammosim.serve.page import add_page

    token = secrets.token_urlsafe(16)
    jobs = add_page(examples, runs.resolve(), command)
    app.add_middleware(Gate, token=token)
    app.on_startup(lambda: say(f"http://{ADDRESS}:{port}/?token={token}"))
    app.on_shutdown(jobs.stop)
    with suppress(KeyboardInterrupt):  # Ctrl-C closes the page
        ui.run(
            host=ADDRESS, port=port, title="mammosim", show=False, reload=False, dark=None,
            show_welcome_message=False, favicon="🩻", reconnect_timeout=60.0,
        )  # fmt: skip
