"""Verified matches between frames, and the features of each, those inside its mask last."""

import shutil
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from gmrdata.cameras.colmap import pycolmap
from gmrdata.cameras.files import Distortion
from gmrdata.cameras.frames import Frames
from gmrdata.cameras.match.features import FeatureFinder, StoredDescriptors, find_features
from gmrdata.cameras.match.retrieval import alike_before
from gmrdata.cameras.recipe import BehindMasksConfig, SfmConfig
from gmrdata.values.camera import straightened
from gmrdata.values.errors import BadFrames, NoReconstruction

DATABASE_FILE = "database.db"
FEWEST_FEATURES = 8  # a frame with fewer can't be matched
MIN_FRAMES = 3  # frames with features that a reconstruction needs at least
MASKED_SHARE = 0.9  # masks that cover more leave nothing to be seen
DARK_GREY = 24  # frames whose 95th percentile is darker are black [of 255]


@dataclass(frozen=True, eq=False)
class PairMatches:
    """Verified matches of two frames, given by their rows."""

    first: int
    second: int
    features: np.ndarray  # (M, 2) feature index in the first and in the second frame
    configuration: str  # By COLMAP's two-view test: CALIBRATED, PLANAR, PANORAMIC, ...


@dataclass(frozen=True, eq=False)
class Matches:
    """All that is known of a sequence before a geometry is chosen."""

    keypoints_px: list[np.ndarray]
    """T arrays (N, 2): image points of each frame, those inside its mask last [px]."""
    pairs: list[PairMatches]  # Pairs with enough verified matches, in order of (first, second)
    n_free: list[int] = field(default_factory=list)
    """How many of each frame's image points are outside its mask: only they are matched with each
    other."""
    descriptors: StoredDescriptors | None = None
    """Of the same image points; None where nothing is masked."""

    @property
    def starts(self) -> np.ndarray:
        """(T+1,) which image point is each frame's first, counted through all frames."""
        return np.cumsum([0, *(len(points_px) for points_px in self.keypoints_px)])

    @property
    def n_of_pair(self) -> dict[tuple[int, int], int]:
        """How many matches each pair of rows has."""
        return {(pair.first, pair.second): len(pair.features) for pair in self.pairs}

    def ends_px(self, pair: PairMatches) -> tuple[np.ndarray, np.ndarray]:
        """(M, 2) places of a pair's matches in its first and in its second frame [px]."""
        first_px, second_px = self.keypoints_px[pair.first], self.keypoints_px[pair.second]
        return first_px[pair.features[:, 0]], second_px[pair.features[:, 1]]

    def some(self, rows: np.ndarray) -> "Matches":
        """Those of some rows (N,), in order, with each other."""
        new = {row: n for n, row in enumerate(rows.tolist())}
        return Matches(
            [self.keypoints_px[row] for row in new],
            [
                replace(pair, first=new[pair.first], second=new[pair.second])
                for pair in self.pairs
                if pair.first in new and pair.second in new
            ],
            [self.n_free[row] for row in new] if self.n_free else [],
            self.descriptors and self.descriptors.some(rows),
        )

    def without(self, lens: Distortion | None, intrinsics_px: np.ndarray) -> "Matches":
        """The same with image points where they would be without distortion."""
        if lens is None:
            return self
        focal_px, middle_px = np.diag(intrinsics_px)[:2], intrinsics_px[:2, 2]
        # Not COLMAP's, which is NaN for what a lens that folds the picture can't show.
        straight = [
            middle_px + focal_px * straightened((seen_px - middle_px) / focal_px, lens.k1, lens.k2)
            for seen_px in self.keypoints_px
        ]
        return replace(self, keypoints_px=straight)


def matched_points(matches: Matches) -> np.ndarray:
    """(T,) how many image points of each frame any pair's matches have."""
    seen = [set[int]() for _ in matches.keypoints_px]
    for pair in matches.pairs:
        seen[pair.first].update(pair.features[:, 0].tolist())
        seen[pair.second].update(pair.features[:, 1].tolist())
    return np.array([len(points) for points in seen], np.int64)


def match_frames(
    frames: Frames,
    work_dir: Path,
    config: SfmConfig,
    finder: FeatureFinder | None = None,
    *,
    calibrated: bool = True,
) -> Matches:
    """Find and match features; COLMAP's `database.db` stays in `work_dir` for the mappers.

    Where the intrinsics are but a guess (not `calibrated`), pairs are verified without them, by a
    fundamental matrix, so that the matches favour no focal length.  A `finder` may have begun
    with these frames, and ends here.
    """
    pycolmap.set_random_seed(config.seed)
    database_path = work_dir / DATABASE_FILE
    with finder or FeatureFinder(frames, work_dir, config) as begun:
        features = find_features(frames, database_path, begun, calibrated=calibrated)
    match_features(database_path, config)
    sort_pairs(database_path)
    matches = read_matches(database_path, frames.images)
    matches = replace(matches, **features._asdict())
    _require_usable(matches, frames)
    return matches


def match_features(database_path: Path, config: SfmConfig, *, verified: bool = True) -> None:
    """Match the images of a database with those that follow, and with some further on; the matches
    are held against the epipolar geometry too where they are to be `verified`."""
    # One thread: with two, pycolmap 4.2.1 now and then gives other matches for the same features.
    matching = pycolmap.FeatureMatchingOptions()
    matching.num_threads = 1
    matching.skip_geometric_verification = not verified
    options = {
        "matching_options": matching,
        "verification_options": verification_options(config),
        "device": pycolmap.Device.cpu,
    }
    pairing = pycolmap.SequentialPairingOptions()
    pairing.overlap, pairing.quadratic_overlap = config.overlap, True
    pairing.num_threads = 1
    pairs_path = database_path.with_name("alike.txt")
    if _write_alike(pairs_path, database_path, config):
        pairing.overlap = min(config.overlap, config.mapping.near_overlap)
        alike = pycolmap.ImportedPairingOptions(match_list_path=pairs_path)
        pycolmap.match_image_pairs(database_path, pairing_options=alike, **options)
    pycolmap.match_sequential(database_path, pairing_options=pairing, **options)


def _write_alike(pairs_path: Path, database_path: Path, config: SfmConfig) -> bool:
    """Write the names of images of a long video that look alike, to be matched; whether there are
    such.

    A short one has each frame's partners 64 and 128 later instead, which reach over all of it.
    """
    with closing(pycolmap.Database.open(database_path)) as database:
        images = sorted(database.read_all_images(), key=lambda image: str(image.name))
        if not config.mapping.in_parts(len(images)):
            return False
        # Of an image without features COLMAP gives a table of (0, 0).
        descriptors = (np.asarray(database.read_descriptors(one.image_id).data) for one in images)
        tables = (table.reshape(-1, 128) for table in descriptors)
        apart = 2 ** (config.mapping.near_overlap - 1)
        pairs = alike_before(tables, apart, config.mapping.alike, config.seed)
    lines = [f"{images[first].name} {images[second].name}\n" for first, second in pairs]
    pairs_path.write_text("".join(lines))
    return bool(pairs)


def verification_options(config: SfmConfig) -> Any:
    """How matches of two frames are held against their epipolar geometry."""
    options = pycolmap.TwoViewGeometryOptions()
    options.min_num_inliers = config.min_pair_inliers
    options.ransac.max_error = config.verification_error_px
    options.ransac.random_seed = config.seed
    # A slow camera leaves matches where they are, as a watermark would.
    options.detect_watermark = False
    return options


def sort_pairs(database_path: Path) -> None:
    """Put the pairs in order: threads write them as they finish, and mappers depend on it."""
    with closing(pycolmap.Database.open(database_path)) as database:
        pair_ids, geometries = database.read_two_view_geometries()
        database.clear_two_view_geometries()
        for i in np.argsort(np.asarray(pair_ids, dtype=np.uint64)):
            image_pair = pycolmap.pair_id_to_image_pair(pair_ids[i])
            database.write_two_view_geometry(*image_pair, geometries[i])


def read_matches(database_path: Path, images: list[Path]) -> Matches:
    """The image points and verified matches of a database, by the rows of its images."""
    with closing(pycolmap.Database.open(database_path)) as database:
        row_of_name = {image.name: row for row, image in enumerate(images)}
        row_of_id: dict[int, int] = {}
        keypoints_px = [np.zeros((0, 2))] * len(images)
        for image in database.read_all_images():
            row = row_of_id[image.image_id] = row_of_name.pop(image.name)
            if database.exists_keypoints(image.image_id):
                points = np.asarray(database.read_keypoints(image.image_id), dtype=np.float64)
                if len(points):
                    keypoints_px[row] = points[:, :2]
        if row_of_name:
            unread = images[min(row_of_name.values())]
            raise BadFrames(f"{unread}: cannot be decoded; extract or copy this frame again")
        pairs = []
        pair_ids, geometries = database.read_two_view_geometries()
        for pair_id, geometry in zip(pair_ids, geometries, strict=True):
            first, second = (row_of_id[i] for i in pycolmap.pair_id_to_image_pair(pair_id))
            features = np.asarray(geometry.inlier_matches, dtype=np.int32).reshape(-1, 2)
            if len(features):
                configuration = pycolmap.TwoViewGeometryConfiguration(geometry.config).name
                if first > second:
                    first, second, features = second, first, features[:, ::-1]
                pairs.append(PairMatches(first, second, features, configuration))
    return Matches(keypoints_px, sorted(pairs, key=lambda pair: (pair.first, pair.second)))


def _why_featureless(frames: Frames) -> str:
    """What keeps the frames from having features, by how much is masked and how bright they are."""
    if frames.masks_dir is not None:
        masked = np.mean([(frames.mask(image) > 127).mean() for image in frames.images])
        if masked > MASKED_SHARE:
            return f"the masks cover {masked:.0%} of the picture; check what made them"
    brightness = np.median([np.percentile(frames.gray(image), 95) for image in frames.images])
    if brightness < DARK_GREY:
        return f"the frames are black (grey value {brightness:.0f} of 255); check the images"
    return "the background is textureless; take a sequence that shows more of its surroundings"


def _require_usable(matches: Matches, frames: Frames) -> None:
    counts = np.array(matches.n_free)
    folder = frames.images[0].parent
    if (counts >= FEWEST_FEATURES).sum() < MIN_FRAMES:
        where = "outside the masks" if frames.masks_dir is not None else "in the frames"
        raise NoReconstruction(
            f"{int(np.median(counts))} features per frame {where}: {_why_featureless(frames)}",
            folder,
        )
    if not matches.pairs:
        raise NoReconstruction(
            "no two frames show the same background; check that the frames are in order and "
            "belong to one take",
            folder,
        )


def match_behind_masks(
    matches: Matches, frames: Frames, work_dir: Path, config: SfmConfig
) -> Matches:
    """Matches with those between a feature inside a mask and one outside, where neighbours hardly
    match outside of both; COLMAP's database in `work_dir` has them too.

    What a person hides at one time shows at another.
    """
    if matches.descriptors is None or not _hardly_match(matches, config.masks):
        return matches
    database_path = work_dir / DATABASE_FILE
    _give_descriptors(matches.descriptors, frames, database_path)
    match_features(database_path, config, verified=False)
    _forget_hidden(matches, frames, database_path)
    verifier = pycolmap.GeometricVerifierOptions()
    verifier.num_threads = 1  # as where they were matched first
    pycolmap.geometric_verification(
        database_path, verifier, two_view_geometry_options=verification_options(config)
    )
    sort_pairs(database_path)
    return replace(matches, pairs=read_matches(database_path, frames.images).pairs)


def _hardly_match(matches: Matches, config: BehindMasksConfig) -> bool:
    """Whether many neighbours have few matches."""
    count = matches.n_of_pair
    rows = range(len(matches.keypoints_px) - 1)
    hardly = [count.get((row, row + 1), 0) < config.hardly_matched for row in rows]
    return bool(np.mean(hardly) >= config.often)


def _give_descriptors(tables: StoredDescriptors, frames: Frames, database_path: Path) -> None:
    """Let a database have the descriptors of all features, and no matches."""
    row_of_name, sift = frames.row_of_name, pycolmap.FeatureExtractorType.SIFT
    with closing(pycolmap.Database.open(database_path)) as database:
        database.clear_matches()
        database.clear_two_view_geometries()
        database.clear_descriptors()
        for image in database.read_all_images():
            table = tables[row_of_name[image.name]]
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


def parted(
    matches: Matches, frames: Frames, after: int, work_dir: Path, parted_dir: Path
) -> Matches:
    """Those that don't join frames up to a row with later ones; `parted_dir` gets a database of
    these alone."""
    parted_dir.mkdir()
    shutil.copy(work_dir / DATABASE_FILE, parted_dir)
    row_of_name = frames.row_of_name
    with closing(pycolmap.Database.open(parted_dir / DATABASE_FILE)) as database:
        late = {
            image.image_id: row_of_name[image.name] > after for image in database.read_all_images()
        }
        for pair_id in database.read_two_view_geometries()[0]:
            pair = pycolmap.pair_id_to_image_pair(pair_id)
            if late[pair[0]] != late[pair[1]]:
                database.delete_two_view_geometry(*pair)
    pairs = [pair for pair in matches.pairs if (pair.first > after) == (pair.second > after)]
    return replace(matches, pairs=pairs)
