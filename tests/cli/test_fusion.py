"""`gmrdata fuse` and `gmrdata delta-errors`, as a user types them."""

import re

import pytest

from gmrdata.cli import main
from gmrdata.fusion.record import RECORD_FILE, FusionRecord
from tests.fusion.test_fuse import Video, clip, video  # noqa: F401  fixtures


def fuse_words(video: Video) -> list[str]:  # noqa: F811
    network, errors = map(str, video.network.values())
    return ["fuse", str(video.pseudo_gt), "--network", network, "--errors", errors]


def test_fuse_says_what_it_found_and_writes_a_page(video, body_path, tmp_path, capsys):  # noqa: F811
    words = [*fuse_words(video), "--body", str(body_path)]
    words += ["--out", str(tmp_path / "out"), "--loops", "0.5:2.5"]
    main([*words, "--dry-run"])
    said = capsys.readouterr().out
    assert re.search(r"walk +90 +30 +60 +1\.00 +1", said)
    assert not (tmp_path / "out").exists()
    main(words)
    said = capsys.readouterr()
    assert "fusion.html" in said.out
    assert "apart, over 3 times --loop-sigma-m 0.1: hardly one spot" in said.err
    record = FusionRecord.read(tmp_path / "out" / RECORD_FILE)
    assert record.people[0].loops[0].time_s == 0.5
    page = (tmp_path / "out" / "fusion.html").read_text("utf-8")
    assert "no camera pose for 1.00 s from 0.67 s on" in page
    assert "at 0.50 s and 2.50 s on one spot" in page
    assert page.count("<svg") == 1
    main(words)
    assert (tmp_path / "out" / "fusion.html").read_text("utf-8") == page


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--loops", "4.2"], "--loops 4.2: give two times in seconds, like 4.2:17.8"),
        (["--loops", "a:b"], "--loops a:b: give"),
        (["--loops", "nan:1"], "--loops nan:1"),
        (["--loops", "-1:1"], "--loops -1:1"),
        (["--loops", "0.5:17.8"], "lasts 2.97 s"),
        (["--loop-sigma-m", "0"], "--loop-sigma-m 0"),
        (["--errors", "nowhere.json"], "nowhere.json: nothing says how wrong the network is"),
        (["--network", "nowhere"], "nowhere"),
    ],
)
def test_bad_flags_are_said(video, tmp_path, gmrdata, more, said):  # noqa: F811
    answer = gmrdata(*fuse_words(video), "--out", tmp_path / "out", *more)
    assert answer.returncode == 1 and said in answer.stderr.replace("\n", "")
    assert not (tmp_path / "out").exists()


def test_a_folder_for_the_errors_is_refused_before_they_are_measured(run_dir, tmp_path, capsys):
    """It was found out after minutes of measuring."""
    (manifest := tmp_path / "none.yaml").touch()
    with pytest.raises(SystemExit):
        main(["delta-errors", str(manifest), "--network", str(run_dir), "--out", str(run_dir)])
    said = capsys.readouterr().err.replace("\n", "")
    assert f"--out {run_dir}: is a folder. Give a file, like" in said


def test_errors_of_a_run_that_held_nobody_out_are_refused(run_dir, tmp_path, gmrdata):
    (manifest := tmp_path / "none.yaml").touch()
    asked = ("delta-errors", manifest, "--network", run_dir, "--out", tmp_path / "e")
    answer = gmrdata(*asked)
    assert answer.returncode == 1 and "stage.json" in answer.stderr.replace("\n", "")
    assert not (tmp_path / "e").exists()
