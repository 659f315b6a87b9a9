"""Cameras up to scale from frames, masks and a lens.

The order of imports, bottom up, which is the order of the method:

    recipe, files, colmap, frames   thresholds, records, COLMAP without noise, frames as worked on
    match/    features, matches, keyframes, tracks: what frames share
    map/      cameras and points from matches: a pure rotation, or COLMAP's mappers; smoothed
    lens/     the lens: as it is given or noted, or as the frames say by matching and mapping a few
    check/    whether cameras can be trusted: a second solution, coverage, the verdict
    reconstruct, again              the stages; the first orders all of it, and chooses between a
                                    camera that only turns and one that moves
"""
