"""Local poses from pictures, by the built-in estimator.

`landmarks` finds and follows people, `landmark_body` says where their landmarks lie on a body,
`lifter` turns landmarks into poses, and `fit` lays a body onto them.
"""
