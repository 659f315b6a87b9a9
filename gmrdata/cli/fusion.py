"""Verbs for cameras and a network together."""

from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from gmrdata.cli import options as flags
from gmrdata.cli.answers import answer, print_table
from gmrdata.cli.gmr import Weights
from gmrdata.stage.run import Run
from gmrdata.values.errors import BadRecipe

if TYPE_CHECKING:
    from gmrdata.fusion.fused_motion import Loop


def fuse(
    source: Positional[Path],
    out: Path,
    gmr: Path | None = None,
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
        gmr: Run folder of `gmrdata train`; the network of the package when left out.
        out: Output folder: fusion.json, fusion.html, and of each person person_<n>.npz and
            sigma_<n>.npz.
        errors: How wrong the network is, from `gmrdata delta-errors`; delta_errors.json in the
            run's folder when left out.
        loops: Pairs of times [s] at which the person stands on one spot, like 4.2:17.8.
        loop_sigma_m: How far apart the pelvis may be then, seen from above (1 sigma) [m].
        like_poses: Whether the network's error where cameras see the person is taken for its error
            in like poses that they don't see.
        feet: Whether planted feet stand still.
        ground: Whether they stand on level ground, at the height that the cameras' world has.
    """
    from pydantic import ValidationError

    from gmrdata.fusion import fused_motion as stage
    from gmrdata.fusion.evidence import fusion_config_of
    from gmrdata.gmr.predict import BUNDLED, network_dir
    from gmrdata.pages.fusion import write_fusion_page

    try:
        config = stage.FuseConfig(
            which=which,
            fusion=fusion_config_of(source).model_copy(
                update={"like_poses": like_poses, "feet": feet, "ground": ground}
            ),
            loops=tuple(map(_loop, loops)),
            loop_sigma_m=loop_sigma_m,
        )
    except ValidationError as error:
        wrong = error.errors()[0]
        flag = str(wrong["loc"][0]).replace("_", "-")
        raise BadRecipe(f"--{flag} {wrong['input']}: {wrong['msg']}") from None
    network = network_dir(BUNDLED if gmr is None else gmr)
    if dry_run:
        print_table(stage.HEADINGS, stage.plan(source, network, config, errors_path=errors))
        return
    made = stage.fuse_people(
        source, network, flags.body_path(body), out, config, errors_path=errors, run=Run(redo=redo)
    )
    record = stage.FusionRecord.read(made / stage.RECORD_FILE)
    print_table(stage.RESULT_HEADINGS, stage.result_rows(record))
    answer(write_fusion_page(made))
    answer(made)


def _loop(text: str) -> "Loop":
    """What a --loops stands for; BadRecipe for what is no pair of times."""
    from gmrdata.fusion.fused_motion import Loop

    first, _, other = text.partition(":")
    try:
        return Loop(time_s=float(first), other_time_s=float(other))
    except ValueError:
        raise BadRecipe(f"--loops {text}: give two times in seconds, like 4.2:17.8") from None


def delta_errors(
    runs: Positional[tuple[Path, ...]],
    manifests: tuple[Path, ...],
    out: Path,
    people: tuple[str, ...] = (),
    pose_noise_deg: float = 3.0,
    fps_hz: float = 30.0,
    which: Weights = "latest",
) -> None:
    """Measure how wrong networks' motions are on the people that their recipes held out.

    Args:
        runs: Run folders of `gmrdata train`; those of one recipe with other people held out say
            together how it does on anybody.
        manifests: The manifests that they were trained on.
        people: On whom to measure, like 2 for CMU's subject 02, where a folder of weights alone
            doesn't say whom its networks were not trained on.
        out: The record, like RUN/delta_errors.json, where `gmrdata fuse` finds it.
        pose_noise_deg: Error put on each joint, as poses of pictures have it.
        fps_hz: Rate of the poses [Hz].
    """
    from pydantic import ValidationError

    from gmrdata.fusion.delta_errors import HEADINGS, error_rows
    from gmrdata.fusion.measured_delta_errors import MeasureConfig, measure_delta_errors

    flags.need(runs, "the run folder of a network")
    flags.need(manifests, "a manifest file")
    try:
        config = MeasureConfig(fps_hz=fps_hz, pose_noise_deg=pose_noise_deg, which=which)
    except ValidationError as error:
        wrong = error.errors()[0]
        flag = str(wrong["loc"][0]).replace("_", "-")
        raise BadRecipe(f"--{flag} {wrong['input']}: {wrong['msg']}") from None
    record = measure_delta_errors(runs, manifests, config, people=people)
    record.write(out)
    print_table(HEADINGS, error_rows(record))
    answer(out)
