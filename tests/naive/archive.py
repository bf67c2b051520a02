"""A DICOM archive for a test: Orthanc on the loopback, in a folder of its own."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import time
import urllib.request
from contextlib import suppress
from pathlib import Path

START_S = 30.0


class Archive:
    """Orthanc, from its start to its end; `with Archive(folder) as archive`."""

    def __init__(self, folder: Path) -> None:
        self._port = _free_port()
        self._settings = folder / "orthanc.json"
        self._settings.write_text(
            json.dumps(
                {
                    "Name": "test", "StorageDirectory": str(folder / "storage"),
                    "IndexDirectory": str(folder / "storage"), "HttpPort": self._port,
                    "RemoteAccessAllowed": False, "AuthenticationEnabled": False,
                    "DicomServerEnabled": False, "Plugins": [],
                }
            )
        )  # fmt: skip

    @staticmethod
    def program() -> str | None:
        """Path of Orthanc, which Debian puts where only root looks."""
        return shutil.which("Orthanc") or shutil.which("Orthanc", path="/usr/sbin")

    def __enter__(self) -> Archive:
        self._process = subprocess.Popen(
            [self.program(), str(self._settings)],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        until = time.monotonic() + START_S
        while time.monotonic() < until:
            with suppress(OSError):
                self._request("system")
                return self
            time.sleep(0.1)
        self.__exit__()
        raise TimeoutError(f"Orthanc did not answer on port {self._port} within {START_S:g} s")

    def __exit__(self, *error: object) -> None:
        self._process.terminate()
        self._process.wait(timeout=30)

    def store(self, path: str) -> None:
        """Send a file."""
        answer = json.loads(self._request("instances", Path(path).read_bytes()))
        assert answer["Status"] in ("Success", "AlreadyStored"), answer

    def find(self, level: str, query: dict[str, str]) -> list[dict]:
        """Studies or series that match, as C-FIND does."""
        asked = {"Level": level, "Query": query, "Expand": True}
        return json.loads(self._request("tools/find", json.dumps(asked).encode()))

    def instances(self) -> dict[str, str]:
        """The archive's own name of each object, by SOP Instance UID."""
        found = json.loads(self._request("instances?expand"))
        return {one["MainDicomTags"]["SOPInstanceUID"]: one["ID"] for one in found}

    def retrieve(self, name: str) -> bytes:
        """One object's file."""
        return self._request(f"instances/{name}/file")

    def _request(self, path: str, body: bytes | None = None) -> bytes:
        address = f"http://127.0.0.1:{self._port}/{path}"
        with urllib.request.urlopen(address, body, timeout=30) as answer:
            return answer.read()


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]
