"""Fetching from a real server on this machine that behaves well and badly."""

import hashlib
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from gmrdata.motion.cmu import (
    RECORD,
    check_trials,
    fetch_command,
    fetch_trials,
    listed_trials,
    wanted_trials,
)
from gmrdata.read.download import FetchConfig, fetch_plan
from gmrdata.values.errors import BadRecipe, BadRecord, FetchFailed
from tests.fixtures.command_line import fails_cleanly
from tests.fixtures.file_server import (
    Answer,
    Handler,
    Server,
    drop_half,
    redirect,
    send,
    slow,
    status,
    tag_of,
)

ASF = b""":units
  length 0.45
  angle deg
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
  begin
     name thigh
     direction 0 -1 0
     length 4
     axis 0 0 0 XYZ
    dof rx rz
  end
:hierarchy
  begin
    root thigh
  end
"""
AMC = b":FULLY-SPECIFIED\n:DEGREES\n" + b"".join(
    b"%d\nroot 1 2 %d 0 0 0\nthigh %d 0\n" % (n, n, n % 90) for n in range(1, 401)
)
FILES = {"/02/02.asf": ASF, "/02/02_03.amc": AMC, "/02/02_04.amc": AMC.replace(b"1 2", b"2 2")}
HALF = len(AMC) // 2


@pytest.fixture
def server(file_server) -> Server:
    file_server.files |= FILES
    return file_server


def _fetch(server: Server, out: Path, *trials: str, **options: object) -> list[float]:
    waits: list[float] = []
    config = FetchConfig(
        base_url=server.url, timeout_s=float(str(options.pop("timeout_s", 5.0))), attempts=3
    )
    rng = np.random.default_rng(1)
    fetch_trials(trials or ("02_03",), out, config, rng, sleep=waits.append, **options)
    return waits


def _names(out: Path) -> list[str]:
    return sorted(path.name for path in out.iterdir())


DONE = ["02.asf", "02_03.amc", "SHA256SUMS", "fetched.json"]


def test_a_good_server_and_once_more(server, tmp_path):
    assert _fetch(server, tmp_path) == []
    assert _names(tmp_path) == DONE
    assert (tmp_path / "02_03.amc").read_bytes() == AMC
    subprocess.run(["sha256sum", "--check", "--strict", "SHA256SUMS"], cwd=tmp_path, check=True)
    record = json.loads((tmp_path / "fetched.json").read_text())
    assert record["files"]["02_03.amc"] == {
        "url": f"{server.url}/02/02_03.amc",
        "size_bytes": len(AMC),
        "sha256": hashlib.sha256(AMC).hexdigest(),
    }
    _fetch(server, tmp_path)
    assert len(server.seen) == 2


def test_a_dropped_connection_is_resumed(server, tmp_path):
    server.answers["/02/02_03.amc"] = [drop_half]
    waits = _fetch(server, tmp_path)
    assert len(waits) == 1 and 0.5 <= waits[0] <= 1.5
    assert server.requests("02_03.amc") == [None, f"bytes={HALF}-"]
    assert (tmp_path / "02_03.amc").read_bytes() == AMC
    assert _names(tmp_path) == DONE


def test_a_later_run_resumes(server, tmp_path):
    server.answers["/02/02_03.amc"] = [drop_half, status(503), status(503)]
    with pytest.raises(FetchFailed, match="1 of 1 trials missing: 02_03\n.*503"):
        _fetch(server, tmp_path)
    assert "02_03.amc" not in _names(tmp_path) and "02_03.amc.part" in _names(tmp_path)
    assert [file.state() for file in wanted_trials(["02_03"], tmp_path, FetchConfig())] == [
        "done",
        "unfinished",
    ]
    _fetch(server, tmp_path)
    assert server.requests("02_03.amc")[-1] == f"bytes={HALF}-"
    assert (tmp_path / "02_03.amc").read_bytes() == AMC and _names(tmp_path) == DONE


def test_a_server_that_ignores_range_and_a_changed_file(server, tmp_path):
    def whole(handler: Handler, body: bytes) -> None:
        send(handler, 200, body, ETag='"x"')

    def other(handler: Handler, body: bytes) -> None:
        send(handler, 206, body[HALF:], ETag='"o"', Content_Range=f"bytes {HALF}-9999/10000")

    server.answers["/02/02_03.amc"] = [drop_half, whole]
    server.answers["/02/02_04.amc"] = [drop_half, other]
    _fetch(server, tmp_path, "02_03", "02_04")
    assert (tmp_path / "02_03.amc").read_bytes() == AMC
    assert (tmp_path / "02_04.amc").read_bytes() == FILES["/02/02_04.amc"]
    assert server.requests("02_04.amc") == [None, f"bytes={HALF}-", None]


def test_500_twice_then_good(server, tmp_path):
    server.answers["/02/02_03.amc"] = [status(500), status(500)]
    waits = _fetch(server, tmp_path)
    assert 0.5 <= waits[0] <= 1.5 and 1.0 <= waits[1] <= 3.0
    assert _names(tmp_path) == DONE


def _cut(handler: Handler, body: bytes) -> None:
    send(handler, 200, body[:-9])


def _longer(handler: Handler, body: bytes) -> None:
    send(handler, 200, body, Content_Length=str(len(body) - 9))


def _page(kind: str) -> Answer:
    return lambda handler, body: send(handler, 200, b"<html>Sorry</html>", Content_Type=kind)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (_cut, "no usable .amc: 02_03.amc:1202: "),
        (_longer, "no usable .amc: 02_03.amc:1202: "),
        (_page("text/html"), "sends a web page"),
        (_page("text/plain"), "no usable .amc: a web page"),
        (redirect("file:///etc/hostname"), "redirects to file:///etc/hostname, which is not"),
        (redirect("ftp://127.0.0.1/02_03.amc"), "redirects to ftp:.* is not followed"),
        (status(403), "answers 403"),
    ],
)
def test_wrong_answers_are_refused_at_once(server, tmp_path, answer, words):
    server.answers["/02/02_03.amc"] = [answer]
    with pytest.raises(FetchFailed, match=words):
        _fetch(server, tmp_path)
    assert _names(tmp_path) == ["02.asf", "SHA256SUMS", "fetched.json"]
    assert len(server.requests("02_03.amc")) == 1


def test_redirects_within_the_web_are_followed(server, tmp_path):
    server.answers["/02/02_03.amc"] = [redirect(f"{server.url}/02/02_04.amc")]
    _fetch(server, tmp_path)
    assert (tmp_path / "02_03.amc").read_bytes() == FILES["/02/02_04.amc"]


def test_a_slow_server(server, tmp_path):
    server.answers["/02/02_03.amc"] = [slow] * 3
    with pytest.raises(FetchFailed, match="timed out.*gave up after 3 attempts"):
        _fetch(server, tmp_path, timeout_s=0.2)
    assert _names(tmp_path) == ["02.asf", "SHA256SUMS", "fetched.json"]


def test_what_is_not_on_the_server_is_named_and_the_others_come(server, tmp_path):
    with pytest.raises(FetchFailed, match="3 of 4 trials missing: 02_99, 77_01, 77_02") as caught:
        _fetch(server, tmp_path, "02_99", "77_01", "77_02", "02_03")
    assert "trial 02_99: " in str(caught.value) and "(404)" in str(caught.value)
    assert "trial 77_02: its skeleton 77.asf is missing" in str(caught.value)
    assert _names(tmp_path) == DONE
    assert len(server.seen) == 4


def test_a_file_that_is_not_as_recorded_is_kept_without_redo(server, tmp_path):
    _fetch(server, tmp_path)
    (tmp_path / "02_03.amc").write_text("mine")
    with pytest.raises(FetchFailed, match="another hash: move it away, or pass --redo"):
        _fetch(server, tmp_path)
    assert (tmp_path / "02_03.amc").read_text() == "mine"
    _fetch(server, tmp_path, redo=True)
    assert (tmp_path / "02_03.amc").read_bytes() == AMC


@pytest.mark.parametrize("name", ["../02_03", "02_3", "2_03", "02_03.amc", "", "02_03\n", "٠٢_٠٣"])
def test_names_that_are_no_trials(name):
    with pytest.raises(BadRecipe, match="no name of a CMU trial"):
        check_trials([name])
    with pytest.raises(BadRecipe, match="no name of a CMU trial"):
        wanted_trials([name], Path(), FetchConfig())


@pytest.mark.parametrize("url", ["file:///tmp", "ftp://127.0.0.1", "127.0.0.1:80", "http://"])
def test_addresses_that_are_not_of_the_web(url, tmp_path):
    with pytest.raises(BadRecipe, match="--base-url"):
        wanted_trials(["02_03"], tmp_path, FetchConfig(base_url=url))
    with pytest.raises(BadRecipe, match="--base-url"):
        rng = np.random.default_rng(1)
        fetch_trials(["02_03"], tmp_path / "out", FetchConfig(base_url=url), rng)
    assert not (tmp_path / "out").exists()


def test_lists_and_addresses(tmp_path):
    trials = listed_trials("paper_table8")
    assert len(trials) == 50 and trials[0] == "02_03"
    with pytest.raises(BadRecipe, match="names no CMU trials"):
        listed_trials("paper_table7")
    _, rows = fetch_plan(wanted_trials(["143_18"], tmp_path / "out", FetchConfig()))
    assert rows[0] == ("143.asf", "http://mocap.cs.cmu.edu/subjects/143/143.asf", "to do")
    assert rows[1][1] == "http://mocap.cs.cmu.edu/subjects/143/143_18.amc"
    assert not (tmp_path / "out").exists()
    assert fetch_command(["02_03", "mine", "02_03"], Path("a b")) == (
        "gmrdata fetch cmu 02_03 --out 'a b'"
    )
    assert fetch_command(["mine"], None) is None


def test_a_list_of_fetched_files_without_a_tag_is_refused(tmp_path):
    (tmp_path / RECORD).write_text('{"files": {}}')
    with pytest.raises(BadRecord, match=r"fetched\.json: has no `format`.*--redo"):
        wanted_trials(["02_03"], tmp_path, FetchConfig())


def test_the_command(server, tmp_path, gmrdata, works):
    common = ("fetch", "cmu", "02_03", "02_99", "--base-url", server.url, "--out", tmp_path)
    fails_cleanly(gmrdata(*common), "1 of 2 trials missing: 02_99")
    assert _names(tmp_path) == DONE
    works(*common, "--dry-run")
    works("fetch", "cmu", "--list", "paper_table8", "--dry-run")
    fails_cleanly(gmrdata("fetch", "cmu"))


def test_a_killed_run_leaves_no_final_name(server, tmp_path):
    def hang(handler: Handler, body: bytes) -> None:
        handler.send_response(200)
        handler.send_header("Content-Length", str(len(body)))
        handler.send_header("ETag", tag_of(body))
        handler.end_headers()
        handler.wfile.write(body[:HALF])
        time.sleep(0.5)

    server.answers["/02/02_03.amc"] = [hang]
    program = "from gmrdata.cli import main; main()"
    arguments = ["fetch", "cmu", "02_03", "--base-url", server.url, "--out", str(tmp_path)]
    process = subprocess.Popen([sys.executable, "-c", program, *arguments])
    end_s = time.monotonic() + 10
    while not (tmp_path / "02_03.amc.part").exists() and time.monotonic() < end_s:
        time.sleep(0.01)
    process.kill()
    process.wait()
    assert "02_03.amc" not in _names(tmp_path) and "02_03.amc.part" in _names(tmp_path)
    _fetch(server, tmp_path)
    assert (tmp_path / "02_03.amc").read_bytes() == AMC and _names(tmp_path) == DONE
