"""The public names: complete, documented, and cheap until they are used."""

import inspect
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import gmrdata
from tests.folders import REPOSITORY

PAGE = REPOSITORY / "docs" / "api.md"
SLOW = ("torch", "bpy", "scipy", "numpy", "cv2", "pycolmap", "pydantic")


def python(code: str) -> str:
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr
    return answer.stdout


def test_importing_is_quick_and_loads_nothing_slow():
    said = python(
        "import sys, time; start = time.process_time(); import gmrdata; "
        "seconds = time.process_time() - start; import json; "
        "print(json.dumps([seconds, gmrdata.__version__, sorted(sys.modules)]))"
    )
    seconds, version, loaded = json.loads(said)
    assert seconds < 0.2
    assert version == gmrdata.__version__
    assert not set(SLOW) & set(loaded)


def test_a_value_loads_no_network_and_no_renderer():
    loaded = python("import sys, gmrdata; gmrdata.Motion, gmrdata.load_clip; print(*sys.modules)")
    assert not {"torch", "bpy", "scipy"} & set(loaded.split())


def test_cameras_alone_load_no_torch():
    """It took two seconds of the seventy that ten seconds of video take."""
    modules = "gmrdata.solve.videos, gmrdata.pages.solved_page"
    assert "torch" not in python(f"import sys, {modules}; print(*sys.modules)").split()


@pytest.mark.parametrize("name", gmrdata.__all__)
def test_each_name_is_there_and_says_what_it_is(name):
    value = getattr(gmrdata, name)
    assert name in dir(gmrdata)
    assert value.__name__ == name
    assert value.__doc__ and len(value.__doc__.split()) >= 4
    if inspect.isfunction(value):
        annotations = inspect.get_annotations(value)
        assert set(annotations) == {*inspect.signature(value).parameters, "return"}


def test_an_unknown_name_is_no_attribute() -> None:
    with pytest.raises(AttributeError, match="no attribute 'train_gmr'"):
        _ = gmrdata.train_gmr  # type: ignore[attr-defined]


def test_editors_see_the_same_names():
    """The imports that type checkers read, and the table that Python reads."""
    source = Path(gmrdata.__file__).read_text(encoding="utf-8")
    told = re.findall(r"^    from gmrdata\.([\w.]+) import (\w+) as \2$", source, re.MULTILINE)
    assert {name: module for module, name in told} == gmrdata._HOME
    assert len(told) == len(gmrdata.__all__)


def on_page() -> dict[str, str]:
    """Parameters, as they are written, by the name that a bullet of the page begins with."""
    text = PAGE.read_text(encoding="utf-8")
    return dict(re.findall(r"^- `(\w+)(?:\(([^`]*)\))?`: \S", text, re.MULTILINE))


def test_the_page_lists_every_name_once():
    text = PAGE.read_text(encoding="utf-8")
    assert sorted(on_page()) == gmrdata.__all__
    assert text.count("\n- `") == len(gmrdata.__all__)


@pytest.mark.parametrize("name", gmrdata.__all__)
def test_the_page_has_the_parameters_of_each_function(name):
    value = getattr(gmrdata, name)
    if not inspect.isfunction(value):
        assert on_page()[name] == ""
        return
    parameters = inspect.signature(value).parameters.values()
    written = [part.strip() for part in on_page()[name].split(",")]
    starred = any(p.kind is p.KEYWORD_ONLY for p in parameters)
    assert ("*" in written) == starred
    assert [part.rstrip("=") for part in written if part != "*"] == [
        ("**" if p.kind is p.VAR_KEYWORD else "") + p.name for p in parameters
    ]
    has_default = {p.name: p.default is not p.empty for p in parameters}
    assert all(
        part.endswith("=") == has_default[part.rstrip("=")]
        for part in written
        if part in has_default
    )


def test_paths_may_be_text(tmp_path, small_body):
    """Records and bodies ended in an AttributeError."""
    body_path, record = str(tmp_path / "body.npz"), str(tmp_path / "verdict.json")
    files = gmrdata.PersonFiles("seen.npz", body_path)
    assert files == replace(files, clip_path=Path("seen.npz"), body_path=Path(body_path))
    gmrdata.save_body(body_path, small_body)
    assert gmrdata.load_body(body_path).name == small_body.name
    with pytest.raises(gmrdata.GmrdataError, match=r"verdict\.json: no such file"):
        gmrdata.VideoVerdict.read(record)
    config = gmrdata.RenderConfig()
    with pytest.raises(gmrdata.GmrdataError, match=r"walk\.npz: no such file"):
        gmrdata.render_clip(str(tmp_path / "walk.npz"), body_path, str(tmp_path / "out"), config)


def test_one_path_is_no_list_of_letters(tmp_path):
    """`o: no such file`, it said of `out/motions.yaml`; and `/` is a folder of many files."""
    path, out = str(tmp_path / "not there.yaml"), tmp_path / "out"
    calls = (
        lambda: gmrdata.train(path, out),
        lambda: gmrdata.train([], out, held_out_paths=path),
        lambda: gmrdata.make_library(path, "anny", out),
        lambda: gmrdata.plan_videos(path),
    )
    for call in calls:
        with pytest.raises(gmrdata.GmrdataError, match=r"not there\.yaml: no such"):
            call()
    with pytest.raises(gmrdata.GmrdataError, match="fewer than two scored runs"):
        gmrdata.compare(path, out)
