"""3DPW's folder to a manifest: python regenerate_threedpw.py 3DPW out/3dpw my.yaml

my.yaml is a copy of pipelines/threedpw.yaml that names your SMPL files.
"""

import sys

import gmrdata

if __name__ == "__main__":
    manifest = gmrdata.regenerate_threedpw(*sys.argv[1:])
    for clip in gmrdata.load_clips(manifest):
        print(f"{clip.id}: {clip.valid.sum()} of {clip.motion.n_frames} frames")
