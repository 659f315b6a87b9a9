"""What frames share: features, matches, keyframes, tracks."""
