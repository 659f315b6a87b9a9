"""Verbs for cameras and a network together."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, Positional

from gmrdata.cli import options as flags
from gmrdata.cli.answers import answer, answer_state, print_table
from gmrdata.cli.gmr import Weights
from gmrdata.stage.progress import remark
from gmrdata.stage.run import Run
from gmrdata.values.errors import BadRecipe

if TYPE_CHECKING:
    from gmrdata.fusion.fuse import Loop


@dataclass(frozen=True)
class Parts:
    """The parts that are put together."""

    loops: tuple[str, ...] = ()
    """Pairs of times [s] at which the person of one clip stands on one spot, like 4.2:17.8."""
    loop_sigma_m: float = 0.1
    """How far apart the pelvis may be then, seen from above (1 sigma) [m]."""
    like_poses: bool = True
    """Whether the network is taken to err as in like poses that cameras saw."""
    feet: bool = True
    """Whether planted feet stand still."""
    ground: bool = True
    """Whether they stand on level ground, at the height that the cameras' world has."""


def fuse(
    source: Positional[Path],
    out: Path,
    network: flags.Network = "bundled",
    errors: Path | None = None,
    body: flags.Body = "anny",
    which: Weights = "latest",
    redo: flags.Redo = False,
    dry_run: flags.DryRun = False,
    *,
    parts: Annotated[Parts, OmitArgPrefixes],
) -> None:
    """Put cameras and a network together: a world motion from first to last seen, with error bars.

    Args:
        source: Folder of a pseudo ground truth, as of `gmrdata video` with people; or one clip.
        out: Output folder: fusion.json, fusion.html, and of each person person_<n>.npz and
            sigma_<n>.npz. Frames in which nobody saw the person have a pose and are not valid.
        errors: How wrong the network is, from `gmrdata delta-errors`; delta_errors.json in the
            run's folder when left out.
    """
    from gmrdata.fusion.camera_evidence import fusion_config_of
    from gmrdata.fusion.fuse import HEADINGS, FuseConfig, plan
    from gmrdata.fusion.fuse import fuse as fuse_people
    from gmrdata.pages.fusion import write_fusion_page

    used = {name: getattr(parts, name) for name in ("like_poses", "feet", "ground")}
    with flags.flags_named():
        config = FuseConfig(
            which=which,
            fusion=fusion_config_of(source).model_copy(update=used),
            loops=tuple(map(_loop, parts.loops)),
            loop_sigma_m=parts.loop_sigma_m,
        )
    fused = partial(
        fuse_people, source, out, network=network, body_path=flags.body_path(body), config=config,
        errors_path=errors,
    )  # fmt: skip
    if dry_run:
        print_table(HEADINGS, plan(source, network=network, config=config, errors_path=errors))
        answer_state(out, fused, redo)
        return
    made = fused(run=Run(redo=redo))
    _say_results(made, parts.loop_sigma_m)
    answer(write_fusion_page(made))
    answer(made)


def _say_results(made: Path, loop_sigma_m: float) -> None:
    from gmrdata.fusion.record import (
        RECORD_FILE,
        RESULT_HEADINGS,
        FusionRecord,
        loop_remarks,
        result_rows,
    )

    record = FusionRecord.read(made / RECORD_FILE)
    print_table(RESULT_HEADINGS, result_rows(record))
    for said in loop_remarks(record, loop_sigma_m):
        remark(said)


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
        people: Subjects to measure on, like 2 for CMU's subject 02. A folder of weights alone
            doesn't say which people its networks were not trained on.
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
    from gmrdata.fusion.network_evidence import DELTA_ERRORS_FILE

    flags.need(network, "the run folder of a network")
    flags.need(manifests, "a manifest file")
    if out.is_dir():  # known before minutes of measuring
        raise BadRecipe(f"--out {out}: is a folder. Give a file, like {out / DELTA_ERRORS_FILE}")
    with flags.flags_named():
        config = MeasureConfig(fps_hz=fps_hz, pose_noise_deg=pose_noise_deg, which=which)
    record = measure_delta_errors(tuple(map(Path, network)), manifests, config, people=people)
    record.write(out)
    print_table(HEADINGS, error_rows(record))
    answer(out)
