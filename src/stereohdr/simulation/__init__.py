"""Simulated cameras and scenes with exact ground truth."""
