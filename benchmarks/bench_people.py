"""Measure people before the camera on real truth: a man before four cameras, and a dancer.

`make bench-people` runs this file alone; `--small` takes one view and no bars.  Everybody is
followed once, in out/bench/people/, and a second run measures poses anew within a minute.  Writes
out/bench/people.json.
"""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from people.before_camera import ViewRow, shirt_row, view_row
from people.real import VIEWS, dance_of, on_the_man, tracks_of, view_of
from record import Bar, Record, at_least, at_most, machine
from render.tables import show

from gmrdata.people.landmark_body import SeenLandmarks
from gmrdata.people.local_poses import LocalPosesConfig, poses_of, sure_frames
from gmrdata.read.models import POSE_LANDMARKS
from gmrdata.values.body import BodyModel
from gmrdata.values.people import LocalPoses

pytestmark = pytest.mark.bench
OUT_DIR = Path("out/bench")
WORK_DIR = (OUT_DIR / "people").resolve()
NETWORK = Path(POSE_LANDMARKS.name).stem.removeprefix("pose_landmark_")
MOST_PA_MEAN_MM, MOST_PA_MM, MOST_REVERSED = 80.0, 95.0, 0.05
MOST_DISTANCE_OFF, MOST_TORSO_OFF = 0.03, 0.02
LEAST_WITHIN_ONE, MOST_WITHIN_ONE, LEAST_WITHIN_TWO = 0.55, 0.85, 0.9


@pytest.fixture(scope="module")
def record(request: pytest.FixtureRequest) -> Record:
    WORK_DIR.mkdir(parents=True, exist_ok=True)
    return Record(OUT_DIR / "people.json", request.config.getoption("--small"), machine)


def test_the_man(record: Record, shared_data: Path, anny: BodyModel) -> None:
    rows: list[ViewRow] = []
    for name in VIEWS[:1] if record.small else VIEWS:
        view = view_of(shared_data / "real", name)
        tracks = tracks_of(shared_data, name, WORK_DIR, view.lens, NETWORK)
        seen, numbers = on_the_man(tracks, view.true_m)
        poses, doubt = _posed(seen, numbers, anny)
        rows.append(view_row(view, poses, anny, doubt))
    show("The man", [asdict(row) for row in rows])
    record.add(network=NETWORK, views=[asdict(row) for row in rows])
    pa_mm = [row.pa_mm for row in rows]
    distance = float(np.median([row.distance_ratio for row in rows]))
    record.hold(
        [
            at_most("mean pa_mm", float(np.mean(pa_mm)), MOST_PA_MEAN_MM),
            at_most("worst pa_mm", max(pa_mm), MOST_PA_MM),
            at_most("reversed_share", max(row.reversed_share for row in rows), MOST_REVERSED),
            at_most("distance off", abs(distance - 1), MOST_DISTANCE_OFF),
            at_most("doubted views", sum(bool(row.doubt) for row in rows), 0),
            *_coverage([row.within for row in rows]),
        ]
    )


def _coverage(within: list[tuple[float, float]]) -> list[Bar]:
    one, two = np.mean(within, axis=0).tolist()
    return [
        at_least("within one sigma", one, LEAST_WITHIN_ONE),
        at_most("within one sigma, at most", one, MOST_WITHIN_ONE),
        at_least("within two sigma", two, LEAST_WITHIN_TWO),
    ]


def _posed(seen: SeenLandmarks, numbers: np.ndarray, body: BodyModel) -> tuple[LocalPoses, str]:
    sure, doubt = sure_frames(seen, body, LocalPosesConfig())
    return poses_of(seen.take(sure), numbers[sure], body, LocalPosesConfig()), doubt


def test_the_dancer(record: Record, shared_data: Path, anny: BodyModel) -> None:
    if record.small:
        pytest.skip("one view is enough to try the parts")
    dance = dance_of(shared_data / "real")
    tracks = tracks_of(shared_data, "dance", WORK_DIR, dance.lens, NETWORK)
    seen, numbers = max(tracks, key=lambda one: len(one[1]))
    poses, doubt = _posed(seen, numbers, anny)
    row = shirt_row(poses, dance, anny)
    show(
        "The dancer",
        [{"people": len(tracks), "frames": len(numbers), "doubt": doubt} | asdict(row)],
    )
    record.add(dancer=asdict(row) | {"people": len(tracks), "frames": len(numbers)})
    record.hold(
        [
            at_most("people", len(tracks), 1),
            at_least("frames", len(numbers), 626),
            at_most("torso off", abs(row.depth_ratio - 1), MOST_TORSO_OFF),
            *_coverage([row.within]),
        ]
    )
