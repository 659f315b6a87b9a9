"""What runs where Linux's own calls are absent: they are taken away, and the same comes out."""

import json
import math
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from unittest.mock import Mock

import pytest

from gmrdata.film import render_set
from gmrdata.stage.workers import own_cores
from gmrdata.values import files, limits

checkpoint = import_module("gmrdata.gmr.checkpoint")
doctor = import_module("gmrdata.cli.doctor")
AWAY = """
import asyncio, builtins, multiprocessing.util, os, pathlib, socket, subprocess, sys, tempfile
for name in ("resource", "fcntl", "termios", "pwd", "grp"):
    sys.modules[name] = None
for name in "sched_getaffinity sched_setaffinity sysconf getloadavg O_TMPFILE link".split():
    vars(os).pop(name)
opened = builtins.open
def guarded(file, *more, **named):
    if str(file).startswith("/proc"):
        raise FileNotFoundError(file)
    return opened(file, *more, **named)
builtins.open = guarded
pathlib.Path.read_text = lambda self, *a, **n: guarded(self).read()
import json
from gmrdata.cli import main
for words in json.loads(sys.argv[1]):
    try:
        main(words)
    except SystemExit as ended:
        if ended.code:
            raise
    print("\\f")
"""


@pytest.mark.slow
def test_verbs_run_without_linuxs_own_calls(walks_command, tmp_path):
    manifest = "motions_out/motions.yaml"
    commands = (
        ("--help",),
        ("doctor", "--json"),
        (*walks_command(2), "--out", "motions_out"),
        ("manifest", "check", manifest),
        ("baseline", "zero", manifest, "--out", "zero"),
        ("evaluate", "zero/predictions", manifest, "--body", "body.npz", "--out", "scores"),
    )
    command = [sys.executable, "-c", AWAY, json.dumps(commands, default=str)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    helped, found, _, checked, *_ = done.stdout.split("\f")
    assert "World-frame human motion data" in helped
    assert "the system does not say" in found
    assert "good" in checked
    assert (tmp_path / "scores/scores.json").is_file()


def test_memory_is_known_or_said_not_to_be(monkeypatch):
    most = limits.machine_bytes()
    assert most is not None and most > 2**29
    monkeypatch.delattr(os, "sysconf")
    assert limits.machine_bytes() is None
    assert limits.blender_bytes() == limits.BLENDER_GIB * 2**30
    rows = {part.name: part.found for part in doctor._machine()}
    assert rows["memory"] == "the system does not say"


def test_cores_are_counted_without_affinity(monkeypatch):
    monkeypatch.delattr(os, "sched_getaffinity")
    rows = {part.name: part.found for part in doctor._machine()}
    assert rows["cores"] == str(os.cpu_count())
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    assert own_cores() == os.cpu_count()


def test_a_dry_run_goes_without_resource(monkeypatch):
    assert 20 < render_set._memory_mib() < 100_000
    monkeypatch.setitem(sys.modules, "resource", None)
    assert math.isnan(render_set._memory_mib())
    probe = render_set.ClipCost(0.5, 2.0, 1e5, 0.0, math.nan)
    plan = render_set.DryRun([], 1, 1, 2, 2, 1, probe)
    assert "nan" not in " ".join(render_set.summary_lines(plan))


def test_windows_asks_for_a_process_without_ending_it(monkeypatch):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    kill = Mock(side_effect=AssertionError("there it ends the process"))
    monkeypatch.setitem(sys.modules, "psutil", Mock(pid_exists={os.getpid(): True}.get))
    monkeypatch.setattr(files.sys, "platform", "win32")
    monkeypatch.setattr(files.os, "kill", kill)
    assert files._is_running(os.getpid()) and not files._is_running(dead.pid)


def test_windows_opens_no_folder_to_force_it_to_the_disk(tmp_path, monkeypatch):
    checkpoint._fsync(tmp_path)
    monkeypatch.setattr(checkpoint.os, "open", Mock(side_effect=PermissionError))
    with pytest.raises(PermissionError):
        checkpoint._fsync(tmp_path)
    monkeypatch.setattr(checkpoint.sys, "platform", "win32")
    checkpoint._fsync(tmp_path)


def test_the_host_has_a_name_without_proc(monkeypatch):
    monkeypatch.setattr(Path, "read_text", Mock(side_effect=FileNotFoundError))
    files.host_word.cache_clear()
    assert len(files.host_word()) == 12
    files.host_word.cache_clear()
