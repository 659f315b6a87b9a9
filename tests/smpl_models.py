"""Random bodies in SMPL's name: the real ones may not be passed on."""

from dataclasses import replace
from pathlib import Path

from gmrdata.read.bodies import save_body
from gmrdata.values.body import BodyModel


def save_smpl(path: Path, small_body: BodyModel, gender: str) -> BodyModel:
    """Write the tests' small body under the name of one of SMPL's."""
    body = replace(small_body, name=f"smpl-{gender}")
    path.parent.mkdir(parents=True, exist_ok=True)
    save_body(path, body)
    return body
