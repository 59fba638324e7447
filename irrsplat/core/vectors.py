"""Vectors in rows: products with a matrix that do not overflow, and unit length."""

from __future__ import annotations

import numpy as np


def times(vectors: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Each row of vectors (N, 3) turned by matrix (3, 3), to the same bits wherever the row stands (a BLAS promises less)."""
    return vectors[:, :1] * matrix[:, 0] + vectors[:, 1:2] * matrix[:, 1] + vectors[:, 2:] * matrix[:, 2]


def unit(vectors: np.ndarray) -> np.ndarray:
    """Each row scaled to length 1; rows of zeros stay zeros."""
    largest = np.abs(vectors).max(axis=1, keepdims=True, initial=0.0)
    scaled = vectors / np.where(largest > 0.0, largest, 1.0)  # so that the squares of tiny ones don't vanish
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    return scaled / np.where(length > 0.0, length, 1.0)
