"""The error of the pseudo ground truth itself, on twins of 3DPW whose truth is known."""
