"""World motion from a file of local poses, and the files it is handed on in.

`stage.infer_world_motion` is what `gmrdata infer` runs.  The same in Python is three lines, which
stand in `gmrdata.local_pose.read`.
"""
