"""Servers that trickle or never end, and addresses that no request can have."""

import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from gmrdata.read.download import FetchConfig, download, folder_address
from gmrdata.values.errors import BadRecipe, FetchFailed
from tests.fixtures.file_server import redirect

HEAD = b"HTTP/1.1 200 OK\r\n"


def _get(url: str, path: Path, **config: float) -> Path:
    return download(
        url, path, FetchConfig(**config), np.random.default_rng(0), sleep=lambda _: None
    )


@pytest.fixture
def trickle() -> Iterator[tuple[str, list[bytes]]]:
    """A server that sends its first answer at once, and then a byte each 20 ms."""
    told: list[bytes] = []
    listening = socket.create_server(("127.0.0.1", 0))
    stop = threading.Event()

    def serve() -> None:
        while not stop.is_set():
            try:
                client, _ = listening.accept()
            except OSError:
                return
            with client:
                try:
                    client.recv(4096)
                    client.sendall(told[0])
                    while not stop.wait(0.02):
                        client.sendall(b"x")
                except OSError:
                    continue

    thread = threading.Thread(target=serve)
    thread.start()
    yield f"http://127.0.0.1:{listening.getsockname()[1]}/a", told
    stop.set()
    listening.shutdown(socket.SHUT_RDWR)
    listening.close()
    thread.join()


@pytest.mark.parametrize(
    "answer",
    [
        HEAD + b"X-Long: ",
        HEAD + b"\r\n",
        HEAD + b"Content-Length: 100000\r\n\r\n",
        HEAD + b"Transfer-Encoding: chunked\r\n\r\n",
    ],
    ids=["headers", "no length", "length", "chunks"],
)
def test_a_server_that_trickles_ends(answer, trickle, tmp_path):
    url, told = trickle
    told.append(answer)
    start_s = time.monotonic()
    with pytest.raises(FetchFailed, match=r"not done after 0\.2 s; gave up after 1 attempts"):
        _get(url, tmp_path / "a", file_limit_s=0.2, attempts=1)
    assert time.monotonic() - start_s < 10
    assert not (tmp_path / "a").exists()


def test_all_attempts_have_an_end(trickle, tmp_path):
    trickle[1].append(HEAD)
    with pytest.raises(FetchFailed, match="gave up after 1 attempts"):
        _get(trickle[0], tmp_path / "a", file_limit_s=0.1, total_limit_s=0.05, attempts=1000)


def test_an_answer_without_end_is_refused(file_server, tmp_path):
    file_server.files["/a"] = bytes(5000)
    with pytest.raises(FetchFailed, match="5000 bytes are more than 1000"):
        _get(f"{file_server.url}/a", tmp_path / "a", largest_bytes=1000)


@pytest.mark.parametrize(
    "url",
    [
        "http://[::1", "http://[zz]/a", "http://bücher.example/", "http://h/ä", "http://h/a b",
        "http://h:99999999/", "http://h:x/", "http://", "http://h/\x00", "http://:80/", "file:///a",
    ],
)  # fmt: skip
def test_addresses_that_are_none(url):
    with pytest.raises(BadRecipe, match=r"--base-url .*must be an http"):
        folder_address(url)


def test_addresses_that_are_some():
    for url in ("http://[::1]:8080/a", "https://xn--bcher-kva.example/%C3%A4"):
        assert folder_address(f"{url}/") == url


@pytest.mark.parametrize("place", ["http://[::1", "http://h:99999999/", "http://b\xfccher./"])
def test_redirects_to_addresses_that_are_none(place, file_server, tmp_path):
    file_server.files["/a"] = b"a"
    file_server.answers["/a"] = [redirect(place)]
    with pytest.raises(FetchFailed, match=f"{file_server.url}/a: "):
        _get(f"{file_server.url}/a", tmp_path / "a", attempts=1)
