"""A DICOM archive for a test: Orthanc on the loopback, in a folder of its own."""

from __future__ import annotations

import json
import re
import shutil
import socket
import subprocess
import time
import urllib.request
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

START_S = 30.0


class Archive:
    """Orthanc, from its start to its end; `with Archive(folder) as archive`."""

    def __init__(self, folder: Path) -> None:
        self._port, self._dicom_port = _free_port(), _free_port()
        self._settings = folder / "orthanc.json"
        self._settings.write_text(
            json.dumps(
                {
                    "Name": "test", "StorageDirectory": str(folder / "storage"),
                    "IndexDirectory": str(folder / "storage"), "HttpPort": self._port,
                    "RemoteAccessAllowed": False, "AuthenticationEnabled": False,
                    "DicomPort": self._dicom_port, "DicomAet": "ARCHIVE", "Plugins": [],
                    "DicomAlwaysAllowGet": True,
                    "DicomModalities": {"test": ["TEST", "127.0.0.1", 104]},
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

    @staticmethod
    def speaks_dicom() -> bool:
        """Whether dcmtk's programs for C-STORE, C-FIND and C-GET are installed."""
        return all(shutil.which(name) for name in ("storescu", "findscu", "getscu"))

    def c_store(self, paths: list[str]) -> None:
        """Send files by C-STORE, each object in a presentation context of its own class."""
        self._dcmtk("storescu", "--required", paths=paths)

    def c_find(self, level: str, **keys: str) -> list[dict[str, str]]:
        """What matches by C-FIND: the value of each of the keys, by keyword."""
        said = self._dcmtk("findscu", "-S", keys={"QueryRetrieveLevel": level, **keys})
        found: list[dict[str, str]] = []
        for line in said.splitlines():
            if "Find Response" in line:
                found.append({})
            elif found and (one := re.search(r"\[(.*?)[ \0]*\].* (\w+)$", line)):
                found[-1][one[2]] = one[1]
        return found

    def c_get(self, study_uid: str, folder: Path) -> list[Path]:
        """Files of a study that C-GET brings back."""
        folder.mkdir()
        keys = {"QueryRetrieveLevel": "STUDY", "StudyInstanceUID": study_uid}
        self._dcmtk("getscu", "-S", "-od", str(folder), keys=keys)
        return sorted(folder.iterdir())

    def _dcmtk(
        self, program: str, *options: str, keys: Mapping[str, str] = {}, paths: Sequence[str] = ()
    ) -> str:
        """What one of dcmtk's programs says; it must succeed."""
        asked = [part for name, value in keys.items() for part in ("-k", f"{name}={value}")]
        called = [program, "-aet", "TEST", "-aec", "ARCHIVE", *options, *asked, "127.0.0.1",
                  str(self._dicom_port), *paths]  # fmt: skip
        done = subprocess.run(called, capture_output=True, timeout=120, check=False)
        said = (done.stdout + done.stderr).decode("utf-8", "replace")
        assert done.returncode == 0, said
        return said

    def store(self, path: str) -> None:
        """Send a file by REST."""
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
