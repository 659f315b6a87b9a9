"""BodyModel, its forward pass, and its readers."""
