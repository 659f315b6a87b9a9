"""Words of the command line in another spelling: the nearest verb, a flag's new name."""

from collections.abc import Collection, Iterator, Mapping, Sequence

from gmrdata.values.errors import nearest

_NETWORKS = {
    "--model": "--detector",
    "--landmarks": "--landmark-network",
    "--weights": "--maskrcnn",
}
_ROOT = {"--root": "--threedpw"}
RENAMED: Mapping[str, Mapping[str, str]] = {
    "masks": _NETWORKS | {"--sources": "--masks"},
    "sfm": _NETWORKS | {"--frames": "the folder or file alone, without a flag"},
    "video": _NETWORKS | {"--fps": "--fps-hz"},
    "baseline": _NETWORKS,
    "threedpw": _ROOT,
    "run": _ROOT,
    "floor": {"--frames": "--clip-frames"},
    "tables": {"--held-out": "--held-out-subjects"},
    "fuse": {"--gmr": "--network"},
    "delta-errors": {"--manifests": "manifests stand first, and networks after --network"},
    "evaluate": {"--predictions": "gmrdata evaluate PREDICTIONS MANIFEST"},
}
"""Of each verb, flags of earlier versions and what stands for them now."""


def misspelled(arguments: Sequence[str], verbs: Collection[str]) -> str | None:
    """What is wrong with a command line before any verb looks at it; None if nothing is."""
    if not arguments or arguments[0].startswith("-"):
        return None
    verb, *rest = arguments
    if verb not in verbs:
        return f"there is no verb {verb!r}{nearest(verb, verbs)}. `gmrdata --help` lists them"
    return next(_renamed(verb, rest), None)


def _renamed(verb: str, rest: Sequence[str]) -> Iterator[str]:
    for word in rest:
        flag = word.split("=")[0].replace("_", "-")
        if flag in RENAMED.get(verb, {}):
            yield f"{verb} {flag} has another name now: {RENAMED[verb][flag]}"
