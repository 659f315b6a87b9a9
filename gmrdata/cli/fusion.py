"""Verbs for cameras and a network together."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from gmrdata.cli import options as flags
from gmrdata.cli.answers import answer, print_table
from gmrdata.cli.gmr import Weights
from gmrdata.stage.run import Run
from gmrdata.values.errors import BadRecipe

if TYPE_CHECKING:
    from gmrdata.fusion.fuse import Loop


def fuse(
    source: Positional[Path],
    out: Path,
    network: flags.Network = "bundled",
    errors: Path | None = None,
    loops: tuple[str, ...] = (),
    loop_sigma_m: float = 0.1,
    body: flags.Body = "anny",
    like_poses: bool = True,
    feet: bool = True,
    ground: bool = True,
    which: Weights = "latest",
    redo: flags.Redo = False,
    dry_run: flags.DryRun = False,
) -> None:
    """Put cameras and a network together: a world motion without gaps, with an error bar a frame.

    Args:
        source: Folder of a pseudo ground truth, as of `gmrdata video` with people; or one clip.
        out: Output folder: fusion.json, fusion.html, and of each person person_<n>.npz and
            sigma_<n>.npz. Frames in which nobody saw the person have a pose and are not valid.
        errors: How wrong the network is, from `gmrdata delta-errors`; delta_errors.json in the
            run's folder when left out.
        loops: Pairs of times [s] at which the person stands on one spot, like 4.2:17.8.
        loop_sigma_m: How far apart the pelvis may be then, seen from above (1 sigma) [m].
        like_poses: Whether the network's error where cameras see the person is taken for its error
            in like poses that they don't see.
        feet: Whether planted feet stand still.
        ground: Whether they stand on level ground, at the height that the cameras' world has.
    """
    from gmrdata.fusion.camera_evidence import fusion_config_of
    from gmrdata.fusion.fuse import HEADINGS, FuseConfig, plan
    from gmrdata.fusion.fuse import fuse as fuse_people
    from gmrdata.fusion.record import RECORD_FILE, RESULT_HEADINGS, FusionRecord, result_rows
    from gmrdata.pages.fusion import write_fusion_page

    parts = {"like_poses": like_poses, "feet": feet, "ground": ground}
    with _flags_named():
        config = FuseConfig(
            which=which,
            fusion=fusion_config_of(source).model_copy(update=parts),
            loops=tuple(map(_loop, loops)),
            loop_sigma_m=loop_sigma_m,
        )
    if dry_run:
        rows = plan(source, network=network, config=config, errors_path=errors)
        print_table(HEADINGS, rows)
        return
    made = fuse_people(
        source,
        out,
        network=network,
        body_path=flags.body_path(body),
        config=config,
        errors_path=errors,
        run=Run(redo=redo),
    )
    print_table(RESULT_HEADINGS, result_rows(FusionRecord.read(made / RECORD_FILE)))
    answer(write_fusion_page(made))
    answer(made)


@contextmanager
def _flags_named() -> Iterator[None]:
    """What a recipe refuses, by the flag that said it."""
    from pydantic import ValidationError

    try:
        yield
    except ValidationError as error:
        wrong = error.errors()[0]
        flag = str(wrong["loc"][0]).replace("_", "-")
        raise BadRecipe(f"--{flag} {wrong['input']}: {wrong['msg']}") from None


def _loop(text: str) -> "Loop":
    """What a --loops stands for; BadRecipe for what is no pair of times."""
    from gmrdata.fusion.fuse import Loop

    first, _, other = text.partition(":")
    try:
        return Loop(time_s=float(first), other_time_s=float(other))
    except ValueError:
        raise BadRecipe(f"--loops {text}: give two times in seconds, like 4.2:17.8") from None


def delta_errors(
    manifests: flags.Manifests,
    network: tuple[str, ...],
    out: Path,
    people: tuple[str, ...] = (),
    pose_noise_deg: float = 3.0,
    fps_hz: float = 30.0,
    which: Weights = "latest",
) -> None:
    """Measure how wrong networks' motions are on the people that their recipes held out.

    Args:
        manifests: The manifests that the networks were trained on.
        network: Run folders of `gmrdata train`; those of one recipe with other people held out say
            together how it does on anybody.
        people: On whom to measure, like 2 for CMU's subject 02, where a folder of weights alone
            doesn't say whom its networks were not trained on.
        out: The record, like RUN/delta_errors.json, where `gmrdata fuse` finds it.
        pose_noise_deg: Error put on each joint, as poses of pictures have it.
        fps_hz: Rate of the poses [Hz].
    """
    from gmrdata.fusion.network_errors import (
        HEADINGS,
        MeasureConfig,
        error_rows,
        measure_delta_errors,
    )

    flags.need(network, "the run folder of a network")
    flags.need(manifests, "a manifest file")
    with _flags_named():
        config = MeasureConfig(fps_hz=fps_hz, pose_noise_deg=pose_noise_deg, which=which)
    record = measure_delta_errors(tuple(map(Path, network)), manifests, config, people=people)
    record.write(out)
    print_table(HEADINGS, error_rows(record))
    answer(out)
