"""Local poses from the files of others: pose estimators' outputs and motion files.

`read.read_local_poses` reads them all.  A local pose is the rotation of each joint in its parent's
frame; where the person is and how the root is turned is not looked at, so it does not matter
whether a file's root is in a camera's frame or in a world.

| file | of | what is read |
|---|---|---|
| `vibe_output.pkl` | VIBE | `pose` (T, 72), `frame_ids`, `betas` of each person |
| `wham_output.pkl` | WHAM | the same |
| `demo_*.pkl` | PHALP, 4D-Humans | `smpl` of each frame's tracks |
| `hmr4d_results.pt` | GVHMR | `body_pose` (T, 63) |
| `.npz` | AMASS (SMPL, SMPL+H, SMPL-X), gmrdata's clips | local rotations |
| `.bvh`, `.amc` | motion capture | retargeted to the SMPL tree |

Estimators' files do not say the video's frame rate; a person has to.
"""
