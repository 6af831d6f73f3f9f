"""Reading photos, reading and writing HDR files."""
