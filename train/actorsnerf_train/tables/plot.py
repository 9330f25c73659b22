"""Perceptual error against the number of shots, one line a method."""

import math
from pathlib import Path

from matplotlib.figure import Figure

from actorsnerf_train.tables.table import MEAN, Row, Table


def write_plot(path: Path, table: Table) -> bool:
    """Whether there was anything to draw: rows with LPIPS of at least two numbers of shots.

    Args:
        path: of the PNG.
        table: the mean over its actors is drawn, or its only actor.
    """
    column = MEAN if len(table.actors) > 1 else table.actors[0]
    lines: dict[str, list[tuple[int, float, float]]] = {}
    for row in table.rows:
        point = _point(row, column)
        if point is not None:
            lines.setdefault(row.label, []).append(point)
    ticks = sorted({shots for points in lines.values() for shots, _, _ in points})
    if len(ticks) < 2:
        return False
    figure = Figure(figsize=(5.5, 3.6), dpi=120)
    axes = figure.subplots()
    for label, points in lines.items():
        shots, values, spreads = zip(*sorted(points), strict=True)
        axes.errorbar(shots, values, yerr=spreads, marker="o", ms=4, lw=1.2, capsize=3, label=label)
    axes.set_xscale("log")
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.minorticks_off()
    axes.set_xlabel("shots M")
    axes.set_ylabel(f"LPIPS x1000, convention {table.convention}")
    axes.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(path)
    return True


def _point(row: Row, column: str) -> tuple[int, float, float] | None:
    cell = row.cells.get(column)
    if cell is None or cell.lpips_x1000 is None or not row.setting.startswith("fewshot-"):
        return None
    spread = cell.lpips_x1000.spread
    spread = math.nan if spread is None else spread  # one seed: no bar
    return int(row.setting.removeprefix("fewshot-")), cell.lpips_x1000.value, spread
