"""The command line: one verb per capability.  Each verb imports its stage only when it runs."""

import sys
from collections.abc import Callable

import tyro

from gmrdata import __version__
from gmrdata.cli.answers import answer, explain, fail
from gmrdata.cli.baselines import baseline
from gmrdata.cli.doctor import doctor
from gmrdata.cli.export import export
from gmrdata.cli.fusion import delta_errors, fuse
from gmrdata.cli.gmr import compare, evaluate, infer, train
from gmrdata.cli.manifests import manifest
from gmrdata.cli.motion_files import fetch, motions, render
from gmrdata.cli.paper_tables import tables
from gmrdata.cli.pseudo_gt import floor, threedpw
from gmrdata.cli.recipes import demo, report, run
from gmrdata.cli.sequence import masks, sfm
from gmrdata.cli.shards import merge, share
from gmrdata.cli.spelling import misspelled
from gmrdata.cli.video import page, video
from gmrdata.values.errors import GmrdataError

_VERBS: tuple[Callable[..., None], ...] = (
    demo, doctor, fetch, motions, render, masks, sfm, video, page, manifest, threedpw, floor, train,
    infer, delta_errors, fuse, evaluate, compare, export, baseline, tables, merge, report, run,
)  # fmt: skip
VERBS = {verb.__name__.replace("_", "-"): verb for verb in _VERBS}


def main(arguments: list[str] | None = None) -> None:
    """Entry point: 0 when done, 1 for an error in input or work, 2 for wrong flags."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments == ["--version"]:
        answer(f"gmrdata {__version__}")
        return
    if wrong := misspelled(arguments, VERBS):
        fail(wrong, code=2)
    try:
        with share(arguments):
            tyro.extras.subcommand_cli_from_dict(
                VERBS,
                prog="gmrdata",
                description="World-frame human motion data.",
                args=arguments,
            )
    except GmrdataError as error:
        fail(str(error))
    except OSError as error:
        fail(explain(error))
    except KeyboardInterrupt:
        fail("stopped. The same command goes on where it was", code=130)
