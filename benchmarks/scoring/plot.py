"""The confusion matrix as a picture."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from benchmarks.scoring.score import columns
from homeward.files import write_whole


def draw_confusion(matrix: dict[str, dict[str, int]], path: Path) -> None:
    """Draw hidden effects against what was named first, with counts, and write it as PNG.

    Args:
        matrix: Counts by row and column.
        path: Where to.
    """
    wide, high = columns(matrix), list(matrix)
    counts = np.array([[matrix[row].get(column, 0) for column in wide] for row in high], dtype=np.float64)
    shares = counts / counts.sum(axis=1, keepdims=True)
    figure = Figure(figsize=(3.5 + 0.36 * len(wide), 2.8 + 0.32 * len(high)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    image = axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    axes.set_xticks(range(len(wide)), [one.replace("_", " ") for one in wide], rotation=60, ha="right")
    axes.set_yticks(
        range(len(high)), [f"{one.replace('_', ' ')} ({counts[i].sum():.0f})" for i, one in enumerate(high)]
    )
    for row, column in zip(*np.nonzero(counts), strict=True):
        ink = "white" if shares[row, column] > 0.6 else "black"
        axes.text(column, row, f"{counts[row, column]:.0f}", ha="center", va="center", color=ink, fontsize=8)
    for index, one in enumerate(high):
        if one in wide:
            corner = wide.index(one) - 0.5, index - 0.5
            axes.add_patch(Rectangle(corner, 1.0, 1.0, fill=False, edgecolor="tab:orange", linewidth=1.5))
    axes.set_xlabel("named first, or verdict where nothing is named")
    axes.set_ylabel("hidden in the case (number of cases)")
    axes.set_title("Concealed cases: what is hidden against what is named first")
    figure.colorbar(image, ax=axes, label="share of the row's cases")
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=110)
    write_whole(path, content.getvalue())
