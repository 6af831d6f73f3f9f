"""The tables of the paper and ours, rerun on any machine."""
