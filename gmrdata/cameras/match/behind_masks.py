"""What masks cover of the background, and its return: into the matches, and into a model.

A filled box covers more background than person.  No point is made of what is only seen inside
masks, so that nobody comes in who stands still or moves slowly: a feature inside a mask counts
where it matches one outside of another frame's, or shows a point that others see outside of theirs.
"""

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.cameras.colmap import project_into, pycolmap
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.match.matches import (
    DATABASE_FILE,
    Matches,
    match_features,
    read_matches,
    sort_pairs,
    verification_options,
)
from gmrdata.cameras.recipe import MasksConfig, SfmConfig


def match_behind_masks(
    matches: Matches, frames: Frames, work_dir: Path, config: SfmConfig
) -> Matches:
    """Matches with those between a feature inside a mask and one outside, where neighbours hardly
    match outside of both; COLMAP's database in `work_dir` has them too.

    What a person hides at one time shows at another.
    """
    if not matches.descriptors or not _hardly_match(matches, config.masks):
        return matches
    database_path = work_dir / DATABASE_FILE
    _give_descriptors(matches, frames, database_path)
    match_features(database_path, config, verified=False)
    _forget_hidden(matches, frames, database_path)
    verifier = pycolmap.GeometricVerifierOptions()
    verifier.num_threads = 1  # as where they were matched first
    pycolmap.geometric_verification(
        database_path, verifier, two_view_geometry_options=verification_options(config)
    )
    sort_pairs(database_path)
    return replace(matches, pairs=read_matches(database_path, frames.images).pairs)


def _hardly_match(matches: Matches, config: MasksConfig) -> bool:
    """Whether many neighbours have few matches."""
    count = matches.n_of_pair
    rows = range(len(matches.keypoints_px) - 1)
    hardly = [count.get((row, row + 1), 0) < config.hardly_matched for row in rows]
    return bool(np.mean(hardly) >= config.often)


def _give_descriptors(matches: Matches, frames: Frames, database_path: Path) -> None:
    """Let a database have the descriptors of all features, and no matches."""
    row_of_name, sift = frames.row_of_name, pycolmap.FeatureExtractorType.SIFT
    with closing(pycolmap.Database.open(database_path)) as database:
        database.clear_matches()
        database.clear_two_view_geometries()
        database.clear_descriptors()
        for image in database.read_all_images():
            table = matches.descriptors[row_of_name[image.name]]
            if len(table):
                descriptors = pycolmap.FeatureDescriptors(sift, table)
                database.write_descriptors(image.image_id, descriptors)


def _forget_hidden(matches: Matches, frames: Frames, database_path: Path) -> None:
    """Take away the matches whose two features are inside masks."""
    row_of_name = frames.row_of_name
    with closing(pycolmap.Database.open(database_path)) as database:
        images = database.read_all_images()
        n_free = {image.image_id: matches.n_free[row_of_name[image.name]] for image in images}
        pair_ids, tables = database.read_all_matches()
        database.clear_matches()
        for pair_id, table in zip(pair_ids, tables, strict=True):
            pair = pycolmap.pair_id_to_image_pair(pair_id)
            outside = np.asarray(table) < [n_free[image_id] for image_id in pair]
            database.write_matches(*pair, table[outside.any(axis=1)])


def see_again(model: Any, matches: Matches, frames: Frames, config: MasksConfig) -> int:
    """Give the points of a model the features inside masks that show them; how many.

    A feature shows a point that must appear there and looked like it when it was seen last.
    """
    if not matches.descriptors:
        return 0
    ids, row_of_name = sorted(model.point3D_ids()), frames.row_of_name
    number = {point_id: n for n, point_id in enumerate(ids)}
    points = np.array([model.point3D(i).xyz for i in ids]).reshape(-1, 3)
    often = np.array(
        [model.point3D(i).track.length() >= config.again_seen for i in ids], dtype=bool
    )
    images = {row_of_name[image.name]: image for image in map(model.image, model.reg_image_ids())}
    seen = {row: _seen_features(image, number) for row, image in sorted(images.items())}
    looks = np.zeros((len(ids), 128), dtype=np.float32)
    # Backwards first: a point that was not seen yet looks as it will.
    for row, (features, of) in reversed(seen.items()):
        looks[of] = _looks(matches.descriptors[row][features])
    added = 0
    for row, (features, of) in seen.items():
        looks_here, n_free = _looks(matches.descriptors[row]), matches.n_free[row]
        looks[of] = looks_here[features]
        hidden = np.setdiff1d(np.flatnonzero(often), of)
        idle = np.setdiff1d(np.arange(n_free, len(looks_here)), features)
        apart_px = project_into(images[row], points[hidden])[:, None]
        apart_px = apart_px - matches.keypoints_px[row][idle]
        near, feature = np.nonzero(np.linalg.norm(apart_px, axis=2) < config.again_px)
        for n, at in _alike(hidden[near], idle[feature], looks, looks_here, config.again_likeness):
            model.add_observation(ids[n], pycolmap.TrackElement(images[row].image_id, at))
            looks[n] = looks_here[at]
            added += 1
    return added


def _seen_features(image: Any, number: dict[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Features (N,) of an image that show points, and the numbers (N,) of these."""
    features = image.get_observation_point2D_idxs()
    of = [number[image.point2D(feature).point3D_id] for feature in features]
    return np.array(features, dtype=np.int64), np.array(of, dtype=np.int64)


def _looks(descriptors: np.ndarray) -> np.ndarray:
    """Descriptors (N, 128) of length 1."""
    floats = descriptors.astype(np.float32)
    return floats / np.maximum(np.linalg.norm(floats, axis=1, keepdims=True), 1)


def _alike(
    point: np.ndarray, feature: np.ndarray, looks: np.ndarray, looks_here: np.ndarray, least: float
) -> list[tuple[int, int]]:
    """Those of M pairs of a point and a feature whose cosine is `least`, each the other's most
    alike; the first of those that are equally alike."""
    likeness = np.einsum("nd,nd->n", looks[point], looks_here[feature])
    best = likeness >= least
    for own, count in ((point, len(looks)), (feature, len(looks_here))):
        most = np.zeros(count, dtype=np.float32)
        np.maximum.at(most, own, likeness)
        best &= likeness == most[own]
    alike = np.flatnonzero(best)
    # One feature may have shown two points, which then look the same to the last bit.
    for own in (point, feature):
        alike = alike[np.sort(np.unique(own[alike], return_index=True)[1])]
    return list(zip(point[alike].tolist(), feature[alike].tolist(), strict=True))
