"""The browser of the tests sees a page's faults."""

from collections.abc import Callable
from pathlib import Path

from tests.browser import Visit

FAULTY = """<p>before</p><script src="https://cdn.example/x.js"></script>
<img src="http://images.example/a.png"><script>
document.querySelector("p").textContent = "after"; console.error("broken"); missing();
</script>"""


def test_complaints_and_requests_are_seen(browse: Callable[[Path], Visit], tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(FAULTY)
    seen = browse(page)
    assert "<p>after</p>" in seen.dom
    assert ['"broken"' in line for line in seen.complaints] == [True, False]
    assert "missing is not defined" in seen.complaints[1]
    assert sorted(seen.requests) == ["http://images.example/a.png", "https://cdn.example/x.js"]


def test_a_page_without_faults(browse: Callable[[Path], Visit], tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text("<p>before</p><script>document.querySelector('p').append(' after')</script>")
    seen = browse(page)
    assert "<p>before after</p>" in seen.dom
    assert (seen.complaints, seen.requests) == ([], [])
