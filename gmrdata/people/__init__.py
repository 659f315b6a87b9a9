"""Local poses from pictures, by the built-in estimator.

`following` finds and follows people, `landmark_network` says where their landmarks are in a
picture, `landmark_body` where on a body, `pose_prior` how joints turn; `fit` lays a body onto them.
"""
