"""The pages as a site: no broken link, every page in the navigation, nothing asked of the net."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.page_commands import pages
from tests.folders import REPOSITORY
from tests.sharing import made_once

LINK = re.compile(r"\]\((?!https?:)([^)#\s]*)(?:#([^)\s]+))?\)")


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The whole site; a warning fails the build."""
    pytest.importorskip("mkdocs", reason="the extra docs is not installed")
    pytest.importorskip("material")

    def make(folder: Path) -> None:
        command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(folder)]
        quiet = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
        built = subprocess.run(
            command, cwd=REPOSITORY, env=quiet, capture_output=True, text=True, check=False
        )
        assert built.returncode == 0, built.stdout + built.stderr

    return made_once(tmp_path_factory, "site", make)


def test_every_page_is_there(site):
    for page in pages():
        place = page.relative_to(REPOSITORY).as_posix().removeprefix("docs/")
        if place != "README.md":
            assert (site / place).with_suffix(".html").is_file(), place


def test_links_out_of_the_folder_lead_to_pages_of_the_site(site):
    text = (site / "training.html").read_text(encoding="utf-8")
    assert 'href="manifests/FORMAT.html"' in text and 'href="pipelines/gmr_cmu.yaml.html"' in text
    recipe = (site / "pipelines/gmr_cmu.yaml.html").read_text(encoding="utf-8")
    assert "held_out_subjects" in recipe
    assert 'href="../export.html' in (site / "manifests/FORMAT.html").read_text(encoding="utf-8")
    assert 'href="scores.html' in (site / "CHANGELOG.html").read_text(encoding="utf-8")
    assert 'href="examples/plot_path.py.html"' in (site / "examples.html").read_text()


def test_public_names_have_their_docstrings_and_fields(site):
    text = (site / "api.html").read_text(encoding="utf-8")
    for name in ("Motion", "train", "load_clip", "Scores"):
        assert f'href="#gmrdata.{name}"' in text and f'id="gmrdata.{name}"' in text
    assert "frame_from_root: R of the paper's eqs. 2-8" in text  # a comment behind a field


def test_a_page_asks_the_net_for_nothing(site, browse):
    visit = browse(site / "index.html")
    assert "What do you want to do?" in visit.dom
    assert [at for at in visit.requests if not at.startswith("file:")] == []
    assert visit.complaints == []


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_links_hold_where_the_repository_is_read(page):
    for link, heading in LINK.findall(page.read_text(encoding="utf-8")):
        target = page.parent / link if link else page
        assert target.exists(), link
        assert not heading or heading in headings(target), f"{link}#{heading}"


def headings(page: Path) -> list[str]:
    """A page's headings as links name them, on a code host and in the site."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    titles = re.findall(r"^#+ (.+)", text, re.MULTILINE)
    return [re.sub(r"[^\w -]", "", title).lower().replace(" ", "-") for title in titles]


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_lists_are_lists_on_a_code_host_and_in_the_site(page):
    """The site's Markdown begins a list after an empty line alone, and a nested one by 4 spaces."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    before = ""
    for line in text.splitlines():
        if item := re.match(r"( *)(?:[-*]|\d+\.) ", line):
            inside = before.startswith(" ") or re.match(r" *(?:[-*]|\d+\.) ", before)
            assert before == "" or inside, line
            assert len(item[1]) % 4 == 0, line
        before = line
