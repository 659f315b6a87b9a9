"""Solids that things are made of, and where one may stand."""

import numpy as np
import pytest

from blender.places.layout import Thing, is_free, mesh_of


@pytest.mark.parametrize("solid", ["box", "taper", "cylinder", "wheel", "blob"])
def test_solids_are_closed_and_face_outwards(solid):
    thing = Thing(
        solid,  # type: ignore[arg-type]
        np.array([3.0, -2.0, 1.0]),
        np.array([1.0, 1.5, 2.0]),
        0.7,
        np.zeros((4, 4, 3), np.float32),
        None,
    )
    mesh = mesh_of(thing, np.random.default_rng(0))
    corners = mesh.vertices_m[mesh.faces]
    a, b, c, d = np.moveaxis(corners - thing.centre_m, 1, 0)
    sixfold_m3 = sum(np.einsum("ij,ij->i", p, np.cross(q, r)) for p, q, r in ((a, b, c), (a, c, d)))
    volume_m3 = sixfold_m3.sum() / 6
    round_m3 = 3.0 * np.pi / 4
    # A frustum's volume is the mean of foot, top and four middles, weighted as in Simpson's rule.
    taper_m3 = 3.0 * (1 + 4 * 0.83 * 0.92 + 0.66 * 0.84) / 6
    full_m3, rel = {
        "box": (3.0, 1e-9),
        "taper": (taper_m3, 1e-9),
        "cylinder": (round_m3, 0.02),
        "wheel": (round_m3, 0.02),
        "blob": (np.pi / 2, 0.5),
    }[solid]
    assert volume_m3 == pytest.approx(full_m3, rel=rel)
    assert mesh.uv.shape == (*mesh.faces.shape, 2)


def test_what_is_free():
    subject, camera = np.array([[0.0, 0.0]]), np.array([[6.0, 0.0]])
    assert is_free(np.array([3.0, 2.0]), 0.5, subject, camera)
    assert not is_free(np.array([3.0, 0.8]), 0.5, subject, camera)  # between them
    assert not is_free(np.array([-1.0, 0.0]), 0.5, subject, camera)  # at the subject
    assert not is_free(np.array([6.5, 1.0]), 0.5, subject, camera)  # at the camera
    assert is_free(np.array([-2.0, 0.0]), 0.5, subject, camera)  # behind the subject
