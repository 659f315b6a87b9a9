"""Local poses from pictures, by the built-in estimator.

`following` finds and follows people, `landmark_network` says where their landmarks are in a picture
and on a body, `lifter` turns landmarks into poses, and `fit` lays a body onto them.
"""
