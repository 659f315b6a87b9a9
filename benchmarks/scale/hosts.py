"""Three hosts on this machine: namespaces with addresses, names and processes of their own.

They share the disk.  The first has the scheduler and the command, the two others a worker each.
Needs root, for the namespaces.  Each fault must end with the bytes of an undisturbed run, or with a
clear error after which a healthy cluster goes on to them.
"""

import os
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from film.set_kills import contents

HOSTS = ("gmra", "gmrb", "gmrc")
BRIDGE, PORT = "gmrbr0", 8786
SCHEDULER = f"tcp://10.77.0.1:{PORT}"
CUT_S = 30.0
LONGEST_S = 420.0  # a run with a fault
QUICK = {
    "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "20s",
    "DASK_DISTRIBUTED__COMM__TIMEOUTS__TCP": "20s",
    "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "10s",
    "OMP_NUM_THREADS": "1",
}
"""A cluster that gives up on a silent host after seconds; Dask's defaults are minutes."""


def _sh(*command: str, check: bool = True) -> None:
    subprocess.run(command, check=check, capture_output=True)


@contextmanager
def network() -> Iterator[None]:
    """Three namespaces on one bridge; gone afterwards, whatever happened."""
    _remove()
    try:
        _sh("ip", "link", "add", BRIDGE, "type", "bridge")
        _sh("ip", "link", "set", BRIDGE, "up")
        for number, host in enumerate(HOSTS, start=1):
            _sh("ip", "netns", "add", host)
            _sh("ip", "link", "add", f"v{host}", "type", "veth", "peer", "name", "eth0",
                "netns", host)  # fmt: skip
            _sh("ip", "link", "set", f"v{host}", "master", BRIDGE, "up")
            inside = ("ip", "-n", host)
            _sh(*inside, "addr", "add", f"10.77.0.{number}/24", "dev", "eth0")
            _sh(*inside, "link", "set", "eth0", "up")
            _sh(*inside, "link", "set", "lo", "up")
        yield
    finally:
        _remove()


def _remove() -> None:
    for host in HOSTS:
        _sh("ip", "link", "del", f"v{host}", check=False)  # with its other end; later else
        _sh("ip", "netns", "del", host, check=False)
    _sh("ip", "link", "del", BRIDGE, check=False)


def plug(host: str, state: str) -> None:
    """Pull a host's cable, or plug it in: `down` or `up`."""
    _sh("ip", "link", "set", f"v{host}", state)


def start(
    host: str,
    command: list[str],
    log: Path,
    *,
    before: str = "",
    env: Mapping[str, str] | None = None,
) -> subprocess.Popen[bytes]:
    """A process on a host, with that host's name; `before` is shell code that it runs first."""
    line = f"hostname {host}; {before} exec {shlex.join(command)}"
    inside = ["unshare", "--uts", "--mount", "--pid", "--fork", "--kill-child", "--mount-proc",
              "sh", "-c", line]  # fmt: skip
    with log.open("ab") as stream:
        return subprocess.Popen(
            ["ip", "netns", "exec", host, *inside],
            stdout=stream, stderr=stream, env=os.environ | QUICK | dict(env or {}),
            start_new_session=True,
        )  # fmt: skip


def stop(process: subprocess.Popen[bytes]) -> None:
    """As a power cut: -9 for all of its processes."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


@dataclass
class Cluster:
    """A scheduler and two workers, as far as they run."""

    root: Path
    log: Path
    processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    def scheduler(self) -> None:
        command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard"]
        self.processes["scheduler"] = start(
            HOSTS[0], [*command, "--host", "10.77.0.1", "--port", str(PORT)], self.log
        )

    def worker(self, host: str, before: str = "", env: Mapping[str, str] | None = None) -> None:
        local = self.root / f"local-{host}"
        local.mkdir(exist_ok=True)
        command = [sys.executable, "-m", "distributed.cli.dask_worker", SCHEDULER]
        command += ["--nthreads", "1", "--no-dashboard", "--local-directory", str(local)]
        self.processes[host] = start(
            host, command, self.log, before=before.format(local=local), env=env
        )

    def stop(self, name: str) -> None:
        stop(self.processes.pop(name))

    def stop_all(self) -> None:
        for name in list(self.processes):
            self.stop(name)


@contextmanager
def cluster(root: Path, first: Callable[[Cluster], None] | None = None) -> Iterator[Cluster]:
    """A cluster on the three hosts; `first` starts the second host's worker in its own way."""
    made = Cluster(root, root / "cluster.log")
    try:
        made.scheduler()
        time.sleep(3.0)
        made.worker(HOSTS[2])
        if first is None:
            made.worker(HOSTS[1])
        else:
            first(made)
        time.sleep(4.0)
        yield made
    finally:
        made.stop_all()
        for host in HOSTS:
            plug(host, "up")


Fault = Callable[[Cluster], None]


def kill_worker(on: Cluster) -> None:
    on.stop(HOSTS[1])


def cut_off_for_a_while(on: Cluster) -> None:
    plug(HOSTS[1], "down")
    time.sleep(CUT_S)
    plug(HOSTS[1], "up")


def cut_off_for_good(on: Cluster) -> None:
    plug(HOSTS[1], "down")


def restart_scheduler(on: Cluster) -> None:
    on.stop("scheduler")
    time.sleep(2.0)
    on.scheduler()


def nothing(on: Cluster) -> None:
    """The fault is in how the worker was started."""


def slow_down(on: Cluster) -> None:
    """A tenth of the time for the worker's processes: stopped for 0.9 s of each second."""
    group = on.processes[HOSTS[1]].pid

    def run() -> None:
        while HOSTS[1] in on.processes:
            for number, wait_s in ((signal.SIGSTOP, 0.9), (signal.SIGCONT, 0.1)):
                with suppress(ProcessLookupError):
                    os.killpg(group, number)
                time.sleep(wait_s)

    threading.Thread(target=run, daemon=True).start()


def with_full_disk(on: Cluster) -> None:
    """Its own disk, where Dask and temporary files go, is full; the shared one is not."""
    before = "mount -t tmpfs -o size=64k none {local}; head -c 60000 /dev/zero > {local}/full;"
    on.worker(HOSTS[1], before, {"TMPDIR": str(on.root / f"local-{HOSTS[1]}")})


def with_other_version(on: Cluster) -> None:
    site = on.root / "site"
    (site / "scipy-0.1.dist-info").mkdir(parents=True, exist_ok=True)
    metadata = "Metadata-Version: 2.1\nName: scipy\nVersion: 0.1\n"
    (site / "scipy-0.1.dist-info" / "METADATA").write_text(metadata)
    on.worker(HOSTS[1], env={"PYTHONPATH": str(site)})


def without_the_folder(on: Cluster) -> None:
    out = on.root / "out"
    out.mkdir(exist_ok=True)
    on.worker(HOSTS[1], f"mount -t tmpfs none {shlex.quote(str(out))};")


FAULTS: dict[str, tuple[Callable[[Cluster], None] | None, Fault]] = {
    "worker killed": (None, kill_worker),
    "host cut off for 30 s": (None, cut_off_for_a_while),
    "host cut off for good": (None, cut_off_for_good),
    "scheduler killed and started again": (None, restart_scheduler),
    "worker ten times slower": (None, slow_down),
    "worker's disk full": (with_full_disk, nothing),
    "worker of another version": (with_other_version, nothing),
    "worker that does not see the folder": (without_the_folder, nothing),
}


def survived(
    name: str, motions: Path, expected: Mapping[str, str], root: Path
) -> dict[str, object]:
    """One fault: what the run ended with, whether a healthy cluster went on, and the bytes."""
    first, fault = FAULTS[name]
    root.mkdir()
    out, said = root / "out", root / "said.log"
    begin_s = time.perf_counter()
    with cluster(root, first) as on:
        run = _start_run(motions, out, said)
        wait_until(lambda: run.poll() is not None or len(list(out.glob("clips/*/stage.json"))) > 3)
        if run.poll() is None:
            fault(on)
        code = _wait(run)
    seconds = time.perf_counter() - begin_s
    text = said.read_text()
    clear = code == 0 or (code == 1 and "gmrdata: " in text and "Traceback" not in text)
    if code != 0:
        with cluster(root):
            _wait(_start_run(motions, out, said))
    same = out.is_dir() and contents(out) == expected
    return {"fault": name, "exit": code, "seconds": round(seconds), "clear": clear,
            "same_bytes": same, "survived": clear and same, "said": _last_words(text)}  # fmt: skip


def undisturbed(motions: Path, root: Path) -> Mapping[str, str]:
    """The files of a run on the three hosts in which nothing happens."""
    root.mkdir()
    with cluster(root):
        assert _wait(_start_run(motions, root / "out", root / "said.log")) == 0
    return contents(root / "out")


def _start_run(motions: Path, out: Path, said: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "gmrdata", "motions", str(motions), "--out", str(out)]
    return start(HOSTS[0], [*command, "--scheduler", SCHEDULER], said)


def _wait(process: subprocess.Popen[bytes]) -> int | None:
    """Exit code; None where it hung and had to be killed."""
    try:
        return process.wait(LONGEST_S)
    except subprocess.TimeoutExpired:
        stop(process)
        return None


def wait_until(done: Callable[[], bool], most_s: float = 120.0) -> None:
    deadline_s = time.monotonic() + most_s
    while not done() and time.monotonic() < deadline_s:
        time.sleep(0.1)


def _last_words(text: str) -> str:
    lines = [line for line in text.splitlines() if line.strip() and "━" not in line]
    return " | ".join(lines[-2:])[-200:]
