"""Synthetic mammograms from labelled voxel breasts."""
