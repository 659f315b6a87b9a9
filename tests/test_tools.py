"""The tests' own tools: the browser sees a page's faults; what is missing skips or fails."""

import os
import subprocess
import sys

import pytest

from tests.folders import REPOSITORY

FAULTY = """<p>before</p><script src="https://cdn.example/x.js"></script>
<img src="http://images.example/a.png"><script>
document.querySelector("p").textContent = "after"; console.error("broken"); missing();
</script>"""


def test_complaints_and_requests_are_seen(browse, tmp_path):
    page = tmp_path / "page.html"
    page.write_text(FAULTY)
    seen = browse(page)
    assert "<p>after</p>" in seen.dom
    assert ['"broken"' in line for line in seen.complaints] == [True, False]
    assert "missing is not defined" in seen.complaints[1]
    assert sorted(seen.requests) == ["http://images.example/a.png", "https://cdn.example/x.js"]


def test_a_page_without_faults(browse, tmp_path):
    page = tmp_path / "page.html"
    page.write_text("<p>before</p><script>document.querySelector('p').append(' after')</script>")
    seen = browse(page)
    assert "<p>before after</p>" in seen.dom
    assert (seen.complaints, seen.requests) == ([], [])


TESTS = {
    "test_body.py": "def test_one(): pytest.skip('no chromium')",
    "test_fixture.py": "@pytest.fixture\ndef data(): pytest.skip('no data')\ndef test_one(data): 0",
    "test_mark.py": "@pytest.mark.skipif(True, reason='no compiler')\ndef test_one(): 0",
    "test_module.py": "pytest.importorskip('no_such_package')\ndef test_one(): 0",
    "test_expected.py": "@pytest.mark.xfail\ndef test_one(): assert 0",
}


@pytest.mark.parametrize(
    ("required", "told"), [("0", "4 skipped, 1 xfailed"), ("1", "1 failed, 1 xfailed, 3 errors")]
)
def test_a_missing_piece_is_named(required, told, tmp_path):
    for name, text in TESTS.items():
        (tmp_path / name).write_text(f"import pytest\n{text}\n")
    variables = {"GMRDATA_TEST_REQUIRE_ALL": required, "PYTHONPATH": str(REPOSITORY)}
    answer = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-ra", "-p", "tests.required"),
            *("--rootdir", tmp_path, "--continue-on-collection-errors", tmp_path),
        ],
        cwd=tmp_path, env=os.environ | variables, capture_output=True, text=True,
    )  # fmt: skip
    assert told in answer.stdout.splitlines()[-1]
    assert answer.returncode == int(required)
    for piece in ("no chromium", "no data", "no compiler", "could not import 'no_such_package'"):
        assert piece in answer.stdout
