"""The GMR network: model, losses, data, training, inference."""
