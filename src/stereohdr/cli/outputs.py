"""What the commands say about the HDR files that they read and write; `stereohdr.io.hdr.FORMATS` is the table."""

from __future__ import annotations

HDR_SUFFIXES = ".exr, .hdr, .pfm, .npy, .tif, .jpg (Ultra HDR), .avif or .jxl"

HDR_OUTPUT = f"HDR image to write: {HDR_SUFFIXES}."
HDR_INPUT = f"HDR image: {HDR_SUFFIXES}."
