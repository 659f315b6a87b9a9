"""A GLB with a camera and with frames that are left out, read again by pygltflib."""

import numpy as np
import pygltflib
import pytest

from gmrdata.values.errors import BadMotionFile
from gmrdata.write.glb import write_glb
from tests.write.takes import HIDDEN, INTRINSICS_PX, N_FRAMES, SIZE_PX


def samples(document: pygltflib.GLTF2, node: str, path: str) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and values of one animated node."""
    (animation,) = document.animations
    for channel in animation.channels:
        if (document.nodes[channel.target.node].name, channel.target.path) == (node, path):
            sampler = animation.samplers[channel.sampler]
            return array(document, sampler.input)[:, 0], array(document, sampler.output)
    raise KeyError(node)


def array(document: pygltflib.GLTF2, number: int) -> np.ndarray:
    accessor = document.accessors[number]
    columns = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type]
    start = document.bufferViews[accessor.bufferView].byteOffset
    blob = document.binary_blob()
    return np.frombuffer(blob, "<f4", accessor.count * columns, start).reshape(-1, columns)


def test_frames_without_a_pose_or_a_camera_have_no_sample(take, tmp_path):
    person, camera = take.people[1], take.camera
    assert camera is not None
    path = tmp_path / "take.glb"
    write_glb(path, person.motion, person.body, shown=person.shown, camera=camera)
    document = pygltflib.GLTF2().load(str(path))
    rows = np.setdiff1d(np.arange(N_FRAMES), HIDDEN)
    times_s, pelvis_m = samples(document, "pelvis", "translation")
    np.testing.assert_allclose(times_s, rows / 29.97, atol=1e-6)
    np.testing.assert_allclose(pelvis_m, person.motion.pelvis_m[rows], atol=1e-6)
    times_s, centres_m = samples(document, "camera", "translation")
    rows = np.flatnonzero(camera.has_camera)
    np.testing.assert_allclose(times_s, rows / 29.97, atol=1e-6)
    np.testing.assert_allclose(centres_m, camera.centres_world_m[rows], atol=1e-6)
    (film,) = document.cameras
    assert film.extras == {"intrinsics_px": INTRINSICS_PX.tolist(), "size_px": list(SIZE_PX)}
    assert np.tan(film.perspective.yfov / 2) == pytest.approx(48 / 160)
    assert film.perspective.aspectRatio == pytest.approx((80 / 150) / (48 / 160))


def test_a_frame_without_a_pose_is_refused_where_it_is_not_left_out(take, tmp_path):
    person = take.people[1]
    with pytest.raises(BadMotionFile, match="NaN in a frame"):
        write_glb(tmp_path / "take.glb", person.motion, person.body)
    assert list(tmp_path.iterdir()) == []
