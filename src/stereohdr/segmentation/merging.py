"""Graph-based merging of super-pixels (Felzenszwalb and Huttenlocher, IJCV 2004)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import LatticeConfig, MergingConfig
from stereohdr.model import Photo
from stereohdr.segmentation._kernels import merge_graph
from stereohdr.segmentation.lattice import superpixel_lattice


def merge_superpixels(means: NDArray[np.float64], *, config: MergingConfig | None = None) -> NDArray[np.int32]:
    """Group the cells of a super-pixel grid into segments.

    Parameters
    ----------
    means
        ``(rows, columns, C)`` float64, mean colour of each super-pixel, 0..255 scale.
    config
        k and the minimum size; a segment's size counts super-pixels.

    Returns
    -------
    ``(rows, columns)`` int32 segment labels, 0, 1, 2, ... in reading order.

    Notes
    -----
    Source: paper section 2.1, Figure 5c; eight-connected grid, weight = Euclidean colour distance. The
    paper's smoothing of sigma 0.1 is the identity on a sampled grid and is left out.
    """
    config = config or MergingConfig()
    rows, columns = means.shape[:2]
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    neighbours = [
        (index[:, :-1], index[:, 1:]),
        (index[:-1, :], index[1:, :]),
        (index[:-1, :-1], index[1:, 1:]),
        (index[:-1, 1:], index[1:, :-1]),
    ]
    first = np.concatenate([a.ravel() for a, _ in neighbours])
    second = np.concatenate([b.ravel() for _, b in neighbours])
    colour = means.reshape(rows * columns, -1)
    weight = np.sqrt(((colour[first] - colour[second]) ** 2).sum(axis=1))
    order = np.argsort(weight, kind="stable")
    roots = merge_graph(
        first[order], second[order], weight[order], index.size, float(config.scale), config.minimum_size
    )
    # A root is the smallest index of its segment, so sorted roots are in reading order.
    return np.unique(roots, return_inverse=True)[1].astype(np.int32).reshape(rows, columns)


def superpixel_means(
    colours: NDArray[np.floating], labels: NDArray[np.int32], shape: tuple[int, int]
) -> NDArray[np.float64]:
    """Return the mean colour ``(rows, columns, C)`` of each lattice cell; empty cells copy a neighbour."""
    cells = shape[0] * shape[1]
    counts = np.bincount(labels.ravel(), minlength=cells)
    sums = [np.bincount(labels.ravel(), channel.ravel(), cells) for channel in np.moveaxis(colours, 2, 0)]
    means = (np.stack(sums, axis=-1) / np.maximum(counts, 1)[:, None]).reshape(*shape, -1)
    empty = (counts == 0).reshape(shape)
    while empty.any():
        for r, c in np.argwhere(empty):
            for neighbour in ((r, c - 1), (r - 1, c), (r, c + 1), (r + 1, c)):
                inside = 0 <= neighbour[0] < shape[0] and 0 <= neighbour[1] < shape[1]
                if inside and not empty[neighbour]:
                    means[r, c] = means[neighbour]
                    empty[r, c] = False
                    break
    return means


def segment_photo(
    photo: Photo, *, lattice: LatticeConfig | None = None, merging: MergingConfig | None = None
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Segment one view by its own codes.

    Returns
    -------
    segments
        ``(H, W)`` int32 labels 0, 1, 2, ... (G_m or G_a of the paper).
    superpixels
        ``(H, W)`` int32 labels of the lattice cells that were merged.
    """
    colours = photo.codes.astype(np.float32) * np.float32(255.0 / photo.white)
    labels, shape = superpixel_lattice(colours, config=lattice)
    segments = merge_superpixels(superpixel_means(colours, labels, shape), config=merging)
    return segments.ravel()[labels], labels
