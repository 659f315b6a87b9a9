"""The network: model, loss, windows, training, inference."""
