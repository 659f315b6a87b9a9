"""GVHMR's `hmr4d_results.pt`.

Written by torch.save (tools/demo/demo.py and hmr4d/model/gvhmr/gvhmr_pl_demo.py of zju3dv/GVHMR):
`smpl_params_global` and `smpl_params_incam`, each with `body_pose` (T, 63) axis-angle of SMPL-X's
21 body joints [rad], `global_orient` (T, 3), `transl` (T, 3) and `betas` (T, 10), beside
`K_fullimg` and the network's own outputs.  The two have the same `body_pose`; that of
`smpl_params_global` is read.  SMPL-X's 21 body joints are SMPL's first; SMPL's two hand joints stay
straight.  The betas are SMPL-X's, which mean something else on SMPL, and are not used.  One file is
one person, in every frame of the video: GVHMR's demo follows one track.
"""

import pickle  # noqa: TID251  Only the name of the error that torch raises.
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.errors import BadMotionFile, UnsafePickle
from gmrdata.local_pose.people import PersonPoses, numbers, rotmats_of_rotvecs
from gmrdata.unpacking import MAX_UNPACKED_BYTES

PARAMETERS = ("smpl_params_global", "smpl_params_incam")
N_SMPLX_BODY = 21
_BROKEN = (
    zipfile.BadZipFile, RuntimeError, EOFError, ValueError, LookupError, TypeError, AttributeError,
    AssertionError, OverflowError, MemoryError, OSError,
)  # fmt: skip
"""What zipfile and torch's reader raise for files whose bytes were changed."""


def read_gvhmr(path: Path) -> list[PersonPoses]:
    """The one person of a file.

    Raises:
        BadMotionFile: the file is truncated, or has other keys, shapes or NaN.
        UnsafePickle: it holds something else than tensors and plain values.
    """
    content = _load(path)
    found = next((content[key] for key in PARAMETERS if key in content), None)
    if not isinstance(found, Mapping) or "body_pose" not in found:
        raise BadMotionFile(
            f"{path}: has no body_pose in {' or '.join(PARAMETERS)} (it has"
            f" {', '.join(map(str, content))[:200]}). Give GVHMR's hmr4d_results.pt"
        )
    poses = numbers(_array(found["body_pose"]), "body_pose", path)
    local_rotmats = rotmats_of_rotvecs(poses, N_SMPLX_BODY, "body_pose", path)
    return [PersonPoses("person", local_rotmats, np.arange(len(poses)), None)]


def _load(path: Path) -> Mapping[str, Any]:
    """The file's dict, with torch's own reader for tensors and nothing else.

    Only the zip form is handed to it, which torch writes since 1.6: in its older form, versions of
    torch before 2.6 could be made to run code (CVE-2025-32434).
    """
    import torch

    try:
        with zipfile.ZipFile(path) as archive:
            size_bytes = sum(entry.file_size for entry in archive.infolist())
        if size_bytes > MAX_UNPACKED_BYTES:
            raise BadMotionFile(f"{path}: unpacks to {size_bytes} bytes, which no motion needs")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # on odd pickle protocols; then it fails
            content = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise UnsafePickle(
            f"{path}: wants something that is not tensors ({str(error).splitlines()[0][:200]})."
            " Do not trust this file; get it from its maker"
        ) from None
    except _BROKEN as error:
        raise BadMotionFile(
            f"{path}: truncated, or not a file of torch.save"
            f" ({type(error).__name__}: {str(error)[:200]}); get it again"
        ) from None
    if not isinstance(content, Mapping):
        raise BadMotionFile(f"{path}: holds no dict. Give GVHMR's hmr4d_results.pt")
    return content


def _array(value: Any) -> Any:
    """A tensor of any type as an array; other values as they are."""
    import torch

    return value.detach().double().numpy() if isinstance(value, torch.Tensor) else value
