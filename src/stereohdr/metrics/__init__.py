"""Metrics that compare a result with a reference."""

from stereohdr.metrics.radiometric import aligning_scale, log2_error, log2_rmse

__all__ = ["aligning_scale", "log2_error", "log2_rmse"]
