"""Bayer mosaics to RGB."""

from stereohdr.demosaicing.bayer import BayerPattern, bayer_pattern, demosaic

__all__ = ["BayerPattern", "bayer_pattern", "demosaic"]
