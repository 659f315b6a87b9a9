"""The verb that checks, shows and compares manifests."""

import sys
from typing import Annotated, Any

from tyro.conf import OmitSubcommandPrefixes, subcommand

from gmrdata.cli.answers import answer
from gmrdata.cli.options import Manifest, Manifests, need
from gmrdata.stage.progress import answers


def manifest_check(paths: Manifests, hashes: bool = True, files: bool = True) -> None:
    """Check manifests: schema, files, hashes, sizes, finite values, proper rotations, paths.

    Args:
        hashes: Read every byte; sizes alone without.
        files: Look at the files; without, only at what the manifests say, for data sets that are
            not here.
    """
    from gmrdata.manifest.check import check_manifest

    need(paths, "a manifest file")
    for path in paths:
        check_manifest(path, hashes=hashes, files=files)
        answer(f"{path}: good")


def manifest_show(path: Manifest) -> None:
    """Show a manifest as a table."""
    from gmrdata.manifest.show import manifest_table

    answers.print(manifest_table(path))


def manifest_diff(a: Manifest, b: Manifest) -> None:
    """Say what differs between two manifests; exit code 1 if anything does."""
    from gmrdata.manifest.show import diff_manifests

    differences = diff_manifests(a, b)
    for line in differences:
        answer(line)
    if differences:
        sys.exit(1)


def manifest(
    verb: OmitSubcommandPrefixes[
        Annotated[Any, subcommand("check", constructor=manifest_check)]
        | Annotated[Any, subcommand("show", constructor=manifest_show)]
        | Annotated[Any, subcommand("diff", constructor=manifest_diff)]
    ],
) -> None:
    """Check, show or compare manifests."""
