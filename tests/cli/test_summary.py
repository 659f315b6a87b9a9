"""The demo's `summary.json`."""

from pathlib import Path

from gmrdata.pages.report_data import ClipSummary, GmrSummary, Summary
from gmrdata.score.records import PaperMetrics
from tests.record_keys import assert_each_key_is_needed


def test_each_key_of_a_summary_is_needed(tmp_path: Path) -> None:
    clip = ClipSummary(
        id="circular",
        camera_motion="circular",
        ome_deg=0.1,
        tme_mm=2.0,
        camera_rotation_deg=0.2,
        scale_error_percent=-1.0,
        frames=26,
        frames_with_camera=25,
    )
    errors = {"ome_deg": 1.0, "tme_mm": 20.0, "vme_mm": 30.0}
    gmr = GmrSummary(**errors, zero_motion=PaperMetrics[float](**errors))
    record = Summary(clips=(clip,), gmr={"synthetic": gmr}, seconds={"render": 60.0})
    assert_each_key_is_needed(record, tmp_path / "summary.json", ("gmr", "seconds"))
