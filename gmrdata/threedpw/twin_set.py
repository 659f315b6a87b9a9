"""A twin set: clips rendered, then written as a dataset in 3DPW's layout, the truth beside it."""

from pathlib import Path

from gmrdata.body.file import read_body
from gmrdata.clip import load_clip
from gmrdata.config import Config
from gmrdata.errors import StageFailed
from gmrdata.extras.config import Extras
from gmrdata.frames import list_images
from gmrdata.progress import track
from gmrdata.render import EXTRAS_FOLDER
from gmrdata.scene_config import SceneConfig
from gmrdata.store import read_json, remove_orphans, run_stage, write_json
from gmrdata.synthetic.draw import clip_rng, render_config
from gmrdata.synthetic.recipe import SyntheticClip
from gmrdata.synthetic.render_set import render_dir, render_set
from gmrdata.synthetic.select import select
from gmrdata.threedpw.layout import IMAGES_DIR, SEQUENCES_DIR, SPLITS
from gmrdata.threedpw.twin import TwinConfig, write_twin
from gmrdata.threedpw.twin_recipe import Split, TwinRecipe

SET_FOLDER, DATASET_FOLDER, TRUTH_FOLDER = "render_set", "3DPW", "truth"
TWINS_FILE = "twins.json"
GENDERS = ("female", "male")


class SequenceTwinConfig(Config):
    """What decides one sequence beside what was rendered."""

    name: str
    """Name of the sequence."""
    split: Split
    """Its split."""
    seed: int
    """The set's seed; faults hang on it and on the name."""
    people: tuple[str, ...]
    """The clips of the annotated people, below the rendered clip's folder."""
    twin: TwinConfig
    """The faults."""


def make_twins(
    recipe: TwinRecipe,
    out_dir: Path,
    *,
    motions_dir: Path | None = None,
    scheduler: str | None = None,
    redo: bool = False,
) -> Path:
    """Render a twin set to `out_dir/render_set`, and write it to `out_dir/3DPW`.

    The truth is kept in `out_dir/truth`: `<name>.p<person>.npz`, the exact clip of each annotated
    person, `<name>.exposure.npz`, and `twins.json`, which says of each sequence what it is.  A run
    that was stopped goes on where it was; the same recipe again does nothing.

    Args:
        recipe: The recipe.
        out_dir: Output folder.
        motions_dir: Folder of motion files.
        scheduler: Address of a Dask cluster for the clips; local processes when None.
        redo: Make anew what another recipe made.

    Returns:
        `out_dir/3DPW`, the root of the dataset.

    Raises:
        MissingInput: not one clip of the recipe can be rendered.
        StageFailed: some clips failed; the sequences of the others are written.
        StaleOutput: something was made by another recipe.
    """
    out_dir = out_dir.resolve()
    failed: StageFailed | None = None
    try:
        render_set(
            recipe.set,
            out_dir / SET_FOLDER,
            motions_dir=motions_dir,
            scheduler=scheduler,
            redo=redo,
        )
    except StageFailed as error:
        failed = error
    failures_dir = out_dir / SET_FOLDER / "failed"
    clips = [
        take.clip
        for take in select(recipe.set, motions_dir).takes
        if not (failures_dir / f"{take.id}.txt").exists()
    ]
    for folder in (out_dir / TRUTH_FOLDER, *(out_dir / DATASET_FOLDER).glob("*/*/")):
        remove_orphans(folder)
    for clip in track(clips, "writing sequences"):
        write_sequence_twin(recipe, clip, out_dir, redo=redo)
    _write_index(out_dir / TRUTH_FOLDER / TWINS_FILE, recipe, clips)
    if failed is not None:
        raise failed
    return out_dir / DATASET_FOLDER


def write_sequence_twin(
    recipe: TwinRecipe, clip: SyntheticClip, out_dir: Path, *, redo: bool = False
) -> Path:
    """Stage: one sequence.  Its folder of images comes last, so one that exists is complete.

    Args:
        recipe: The recipe.
        clip: One of its clips, already rendered below `out_dir/render_set`.
        out_dir: The twin set's folder.
        redo: Make anew what another recipe made.

    Returns:
        The folder of images.

    Raises:
        MissingInput: the clip was not rendered.
        StaleOutput: the sequence was made by another recipe or from other frames.
    """
    rendered = render_dir(out_dir / SET_FOLDER, clip.id)
    root, truth_dir = out_dir / DATASET_FOLDER, out_dir / TRUTH_FOLDER
    body_path = out_dir / SET_FOLDER / "body" / "body.npz"
    config = SequenceTwinConfig(
        name=clip.id,
        split=recipe.splits.get(clip.id, recipe.split),
        seed=recipe.set.seed,
        people=_annotated(_place(recipe, clip).extras),
        twin=recipe.twin,
    )
    paths = [rendered / file for file in config.people]

    def work(partial_dir: Path) -> None:
        for split in SPLITS:  # of another recipe, which had more people or another split
            (root / SEQUENCES_DIR / split / f"{clip.id}.pkl").unlink(missing_ok=True)
        for stale in truth_dir.glob(f"{clip.id}.p[0-9].npz"):
            stale.unlink()
        rng = clip_rng(recipe.set.seed, clip.id, "faults")
        genders = [GENDERS[int(rng.integers(2))] for _ in paths]
        write_twin(
            root,
            config.split,
            clip.id,
            [load_clip(path) for path in paths],
            list_images(rendered / "frames"),
            genders,
            read_body(body_path),
            truth_dir,
            config.twin,
            rng,
            image_dir=partial_dir,
        )

    inputs = {"frames": rendered / "frames", "body": body_path}
    inputs |= {f"person{number}": path for number, path in enumerate(paths)}
    return run_stage("twin", root / IMAGES_DIR / clip.id, config, inputs, work, redo=redo)


def _annotated(extras: Extras) -> tuple[str, ...]:
    return ("clip.npz", *(f"{EXTRAS_FOLDER}/{name}.npz" for name in extras.names[: extras.company]))


def _place(recipe: TwinRecipe, clip: SyntheticClip) -> SceneConfig:
    return render_config(recipe.set, clip).scene


def _write_index(path: Path, recipe: TwinRecipe, clips: list[SyntheticClip]) -> None:
    """Write what each sequence is; a file that says the same is left alone."""
    index = {"sequences": [_about(recipe, clip) for clip in clips]}
    if not path.is_file() or read_json(path) != index:
        write_json(path, index)


def _about(recipe: TwinRecipe, clip: SyntheticClip) -> dict[str, object]:
    scene = _place(recipe, clip)
    return {
        "name": clip.id,
        "class_true": clip.programme.kind,
        "trial": clip.trial or f"gait {clip.gait}",
        "people": 1 + scene.extras.company,
        "scene": scene.model_dump(mode="json"),
        "programme": clip.programme.model_dump(mode="json"),
    }
