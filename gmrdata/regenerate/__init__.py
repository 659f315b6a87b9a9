"""World-frame pseudo ground truth for a whole data set in 3DPW's layout."""
