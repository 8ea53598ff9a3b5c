"""Gaussian splats: the cloud and its file, rasteriser, losses, binding to a mesh, training."""
