# SPDX-License-Identifier: GPL-3.0-or-later
"""A user's .blend file as the place: what it shows, and nothing of what it would do."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from gmrdata.film.scene import BackdropConfig
from gmrdata.values.errors import BadBackdrop
from gmrdata.values.limits import MOST_PIXELS
from gmrdata.values.transforms import about_z

_FILE_NODES = ("ShaderNodeTexIES", "ShaderNodeScript")


def add_backdrop(scene: Any, config: BackdropConfig) -> None:
    """Put the meshes, lamps and sky of a file into an empty bpy scene.

    They come as they were saved: no animation, driver or script of the file is run.

    Args:
        scene: The bpy scene.
        config: Which file, and where our world lies in its.

    Raises:
        BadBackdrop: the file can't be read, is of a newer Blender, shows nothing, needs others, or
            isn't in metres.
    """
    theirs = _load(config)
    _require_all_inside(config.path)
    _require_sizes(config.path)
    _require_metres(config.path, theirs.unit_settings)
    _freeze()
    things = list(theirs.objects)
    for group, excluded in list(_exclusions(theirs.view_layers[0].layer_collection)):
        group.children.unlink(excluded)
    for part in (*bpy.data.collections, *bpy.data.objects):  # rays meet what the viewport shows
        part.hide_viewport = part.hide_render
    _place(scene, theirs.collection, config)
    scene.world = theirs.world
    if scene.world is not None and scene.world.node_tree is not None:
        _turn_sky(scene.world.node_tree, np.deg2rad(config.yaw_deg))
    view, their_view = scene.view_settings, theirs.view_settings
    view.view_transform, view.look = their_view.view_transform, their_view.look
    view.exposure, view.gamma = their_view.exposure, their_view.gamma
    bpy.data.scenes.remove(theirs)
    if not any(thing.type == "MESH" and not thing.hide_render for thing in things):
        raise BadBackdrop(f"{config.path}: has no mesh that is rendered; film another scene")


def _load(config: BackdropConfig) -> Any:
    """The file's scene, appended beside ours."""
    path = config.path
    # Off by default; said here, since a file's drivers and scripts must never run.
    bpy.context.preferences.filepaths.use_scripts_auto_execute = False
    try:
        with bpy.data.libraries.load(str(path), link=False) as (there, wanted):
            wanted.scenes = [_choose(config, list(there.scenes))]
    except OSError as error:
        said = str(error).strip()
        raise BadBackdrop(
            f"{path}: Blender {bpy.app.version_string} can't read it ({said}); "
            "give a .blend file that this Blender or an older one saved"
        ) from None
    library = next(each for each in bpy.data.libraries if _is_of(each, path))
    version = tuple(library.version)
    if version[:2] > bpy.app.version[:2]:
        raise BadBackdrop(
            f"{path}: saved by Blender {version[0]}.{version[1]}, newer than this "
            f"{bpy.app.version_string}; save it with an older one"
        )
    return wanted.scenes[0]


def _is_of(library: Any, path: Path) -> bool:
    """Whether a library is a file's own; one that it links may have the same name elsewhere."""
    return Path(library.filepath).resolve() == path.resolve()


def _choose(config: BackdropConfig, names: list[str]) -> str:
    if config.scene_name is None and len(names) == 1:
        return names[0]
    if config.scene_name in names:
        return str(config.scene_name)
    wanted = "" if config.scene_name is None else f" and not {config.scene_name!r}"
    raise BadBackdrop(
        f"{config.path}: has the scenes {', '.join(names) or '(none)'}{wanted}; "
        "name one of them as backdrop.scene_name"
    )


def _require_all_inside(path: Path) -> None:
    """Only the .blend counts in the recipe's hashes, so nothing may come from elsewhere."""
    outside = [
        image.name
        for image in bpy.data.images
        if image.source in ("FILE", "SEQUENCE", "MOVIE", "TILED") and not len(image.packed_files)
    ]
    outside += [each.name for each in bpy.data.libraries if not _is_of(each, path)]
    outside += [*_other_files(), *_reading_nodes()]
    if outside:
        raise BadBackdrop(
            f"{path}: needs other files ({', '.join(sorted(outside))}). In Blender: File, External "
            "Data, Pack Resources (and Pack Linked Libraries), then save"
        )


def _other_files() -> list[str]:
    """What is in files of its own beside pictures: letters, volumes, animated meshes."""
    data = bpy.data
    return [
        each.name
        for kind in (data.fonts, data.volumes, data.cache_files)
        for each in kind
        if each.filepath != "<builtin>" and getattr(each, "packed_file", None) is None
    ]


def _nodes() -> list[Any]:
    data = bpy.data
    owners = (*data.materials, *data.lights, *data.worlds)
    trees = [*data.node_groups, *(each.node_tree for each in owners if each.node_tree)]
    return [node for tree in trees for node in tree.nodes]


def _reading_nodes() -> list[str]:
    """Nodes that read a file when they are evaluated."""
    return [
        node.name
        for node in _nodes()
        if node.bl_idname.startswith("GeometryNodeImport")
        or (node.bl_idname in _FILE_NODES and node.mode == "EXTERNAL")
    ]


def _require_sizes(path: Path) -> None:
    """Refuse pictures that Blender would make by itself, and without a word go without them."""
    for image in bpy.data.images:
        n_pixels = image.generated_width * image.generated_height
        if image.source == "GENERATED" and n_pixels > MOST_PIXELS:
            raise BadBackdrop(
                f"{path}: its picture {image.name!r} has {n_pixels} pixels, and {MOST_PIXELS} are "
                "the most; make it smaller"
            )


def _require_metres(path: Path, units: Any) -> None:
    """Refuse a file in another unit: its lamps are set for that one, so it can't just be scaled."""
    if units.system != "NONE" and abs(units.scale_length - 1.0) > 1e-3:
        scale = f"{units.scale_length:.4g}"
        raise BadBackdrop(
            f"{path}: its Unit Scale is {scale}, so its lengths are no metres; in Blender scale "
            f"all by {scale} and apply that, see to the lamps' power, set Unit Scale to 1 and save"
        )


def _freeze() -> None:
    """Drop the actions and drivers of everything, which so stays as it was saved."""
    for block in _everything():
        if hasattr(block, "animation_data_clear"):
            block.animation_data_clear()
        tree = getattr(block, "node_tree", None)
        if tree is not None:
            tree.animation_data_clear()
    for text in list(bpy.data.texts):
        bpy.data.texts.remove(text)


def _everything() -> Iterator[Any]:
    data = bpy.data
    for group in (data.objects, data.meshes, data.materials, data.lights, data.worlds):
        yield from group
    for group in (data.shape_keys, data.node_groups, data.curves, data.armatures, data.lattices):
        yield from group
    for group in (data.scenes, data.collections, data.volumes, data.pointclouds, data.metaballs):
        yield from group


def _exclusions(layer: Any) -> Iterator[tuple[Any, Any]]:
    """The collections that are switched off in the file, each after the one that it is in."""
    for child in layer.children:
        if child.exclude:
            yield layer.collection, child.collection
        else:
            yield from _exclusions(child)


def _place(scene: Any, theirs: Any, config: BackdropConfig) -> None:
    """Show a scene's collection, turned and shifted as one, so that the file's origin is ours.

    In a world of its own everything stays where parents, constraints and instances put it.
    """
    whole = bpy.data.collections.new("backdrop")
    for group in theirs.children:
        whole.children.link(group)
    for thing in theirs.objects:
        whole.objects.link(thing)
    yaw_rad = np.deg2rad(config.yaw_deg)
    place = bpy.data.objects.new("backdrop", None)
    place.instance_type, place.instance_collection = "COLLECTION", whole
    place.location = about_z(-yaw_rad) @ -np.array(config.origin_m)
    place.rotation_euler = (0.0, 0.0, -yaw_rad)
    scene.collection.objects.link(place)
    graph = bpy.context.evaluated_depsgraph_get()
    for node in _nodes():
        if node.bl_idname == "ShaderNodeTexCoord" and node.object is not None:
            axes = bpy.data.objects.new("axes", None)  # shaders are in our world, and need them
            axes.parent = place
            axes.matrix_parent_inverse = node.object.evaluated_get(graph).matrix_world
            scene.collection.objects.link(axes)
            node.object = axes


def _turn_sky(tree: Any, yaw_rad: float) -> None:
    """Look into a sky's picture in the file's direction."""
    for sky in [node for node in tree.nodes if node.type == "TEX_ENVIRONMENT"]:
        turn = tree.nodes.new("ShaderNodeVectorRotate")
        turn.rotation_type = "Z_AXIS"
        turn.inputs["Angle"].default_value = yaw_rad
        links = sky.inputs["Vector"].links
        if links:
            source = links[0].from_socket
        else:
            source = tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"]
        tree.links.new(source, turn.inputs["Vector"])
        tree.links.new(turn.outputs["Vector"], sky.inputs["Vector"])
