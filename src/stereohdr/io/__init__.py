"""Reading photos, reading and writing HDR files."""

from __future__ import annotations

from stereohdr.io.hdr import read_hdr, write_hdr
from stereohdr.io.photos import read_photo

__all__ = ["read_hdr", "read_photo", "write_hdr"]
