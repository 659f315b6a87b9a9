"""A phone video to a GLB of its people: python video_to_glb.py walk.mp4 out/walk"""

import sys

import gmrdata

if __name__ == "__main__":
    video, out = sys.argv[1:]
    gmrdata.fetch_models()
    verdict = gmrdata.VideoVerdict.read(gmrdata.solve_video(video, out))
    print("accepted" if verdict.accepted else f"rejected: {'; '.join(verdict.reasons)}")
    for made in gmrdata.export(out, ("glb",), f"{out}/exported"):
        print(made.unit.path, made.left_out)
