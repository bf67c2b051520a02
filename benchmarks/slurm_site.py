"""A SLURM cluster of three nodes on one machine, in namespaces of its own.

Needs root, Debian's `slurmctld`, `slurmd`, `slurm-client`, `munge` and `iproute2`; none of their
services has to run. A node is `slurmd` with a host name and a network of its own, joined to the
others by `ib0`: nothing reaches another network. All processes are in one process namespace, and
end with the script that made it. The nodes share this machine's processors and file system.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import psutil

NODES = (1, 2, 3)
PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "ip", "setpriv", "unshare")
SPACES = ("unshare", "--net", "--uts", "--mount", "--pid", "--fork", "--mount-proc", "--kill-child")
WITH_ITS_PARENT = ("setpriv", "--pdeathsig", "KILL")
MAX_SECONDS = 900.0

SLURM_CONF = """
ClusterName=trial
SlurmctldHost=login(10.77.0.1)
SlurmUser=root
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/affinity
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SlurmdParameters=config_overrides
SlurmdTimeout=10
ReturnToService=2
MinJobAge=3600
KillWait=10
MailProg=/bin/true
NodeName=n[1-3] CPUs=2 RealMemory=6000 NodeAddr=10.77.0.[11-13]
PartitionName=standard Nodes=ALL Default=YES MaxTime=UNLIMITED State=UP
"""


def enter(*arguments: str) -> int:
    """Run this script again in namespaces and a temporary folder; its exit status."""
    missing = [name for name in PROGRAMS if shutil.which(name) is None]
    if os.geteuid() or missing:
        sys.exit(f"needs root, and of programs: {' '.join(missing) or 'no more'}")
    with tempfile.TemporaryDirectory() as folder:
        again = [sys.executable, sys.argv[0], *arguments, "--folder", folder]
        signal.signal(signal.SIGTERM, lambda *_: sys.exit("terminated"))
        return subprocess.call([*WITH_ITS_PARENT, *SPACES, *again])


@dataclass
class Site:
    """The cluster; `nodes` are its nodes' first processes."""

    folder: Path
    nodes: dict[int, subprocess.Popen[bytes]] = field(default_factory=dict)

    def start(self) -> None:
        """Start the controller here, and every node."""
        conf, scratch = self.folder / "slurm.conf", self.folder / "tmp"
        conf.write_text(SLURM_CONF.format(folder=self.folder))
        scratch.mkdir()
        os.environ |= {"SLURM_CONF": str(conf), "TMPDIR": str(scratch)}
        for line in (
            "mount -t tmpfs -o mode=755 tmpfs /run", "mkdir /run/munge", "hostname login",
            "ip link set lo up", "ip link add ib0 type bridge", "ip addr add 10.77.0.1/24 dev ib0",
            "ip link set ib0 up",
        ):  # fmt: skip
            shell(line)
        key = self.folder / "munge.key"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o400)
        files = [f"--{name}-file={self.folder}/munge.{name}" for name in ("log", "pid", "seed")]
        self._daemon("munged", "--foreground", "--force", "--key-file", str(key), *files)
        wait(Path("/run/munge/munge.socket.2").exists, "munged does not start")
        self._daemon("slurmctld", "-D")
        for node in NODES:
            self.start_node(node)
        self.wait_for_nodes()

    def start_node(self, node: int) -> None:
        """A node; its network card is handed to it as soon as it has a network."""
        shell(f"ip link add port{node} type veth peer name card{node}")
        shell(f"ip link set port{node} master ib0 up")
        process = self.nodes[node] = self._daemon(
            "unshare", "--net", "--uts", "sh", "-c",
            f"hostname n{node}; until ip link set card{node} name ib0; do sleep 0.1; done; "
            f"ip link set lo up; ip addr add 10.77.0.1{node}/24 dev ib0; ip link set ib0 up; "
            f"exec slurmd -D -N n{node}",
        )  # fmt: skip
        wait(lambda: network_of(process.pid) != network_of(os.getpid()), "a node has no network")
        shell(f"ip link set card{node} netns {process.pid}")

    def stop_node(self, node: int) -> int:
        """Take a node's network away, then kill all that runs on it; how many processes."""
        network = network_of(self.nodes[node].pid)
        shell(f"ip link delete port{node}")
        gone = [process for process in psutil.process_iter() if network_of(process.pid) == network]
        for process in gone:
            process.kill()
        return len(gone)

    def wait_for_nodes(self) -> None:
        """Wait until SLURM would start jobs on all nodes."""
        ready = ["idle"] * len(NODES)
        wait(lambda: shell("sinfo -h -N -o %T").split() == ready, "a node does not come up")

    def jobs(self, place: Path) -> dict[str, int]:
        """How many jobs submitted from a folder are in which state, ended ones too."""
        lines = shell("squeue -h -t all -o %T|%Z").splitlines()
        found = Counter(state for state, _, where in map(_parts, lines) if where == str(place))
        return dict(found)

    def wait_for_jobs(self) -> None:
        """Wait until no job is left."""
        wait(lambda: not shell("squeue -h -o %T").split(), "jobs are left over")

    def _daemon(self, *words: str) -> subprocess.Popen[bytes]:
        log = (self.folder / "daemons.log").open("ab")
        return subprocess.Popen(words, stdout=log, stderr=log)


def _parts(line: str) -> tuple[str, str, str]:
    return line.partition("|")


def network_of(pid: int) -> str:
    """Network namespace of a process; empty if it is gone."""
    try:
        return os.readlink(f"/proc/{pid}/ns/net")
    except OSError:
        return ""


def job_of(pid: int) -> str:
    """SLURM's number of the job that a process belongs to; empty if it is gone."""
    try:
        return psutil.Process(pid).environ().get("SLURM_JOB_ID", "")
    except psutil.Error:
        return ""


def shell(line: str) -> str:
    """What a command prints."""
    return subprocess.run(line.split(), check=True, capture_output=True, text=True).stdout


def wait(due: Callable[[], object], otherwise: str) -> None:
    """Wait until something is so."""
    until = time.monotonic() + MAX_SECONDS
    while not due():
        if time.monotonic() > until:
            sys.exit(otherwise)
        time.sleep(0.2)
