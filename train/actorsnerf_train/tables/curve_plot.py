"""Perceptual error against steps and against training time, one line a method and setting."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from actorsnerf_train.tables.curves import Line


def write_curve_plot(path: Path, lines: Sequence[Line]) -> bool:
    """Whether there was anything to draw: curves with LPIPS.

    Args:
        path: of the PNG.
        lines: mean curves; each setting has its row of the figure.
    """
    drawn = [line for line in lines if _distances(line) is not None]
    if not drawn:
        return False
    settings = list(dict.fromkeys(line.setting for line in drawn))
    colours = {label: f"C{i}" for i, label in enumerate(dict.fromkeys(x.label for x in drawn))}
    figure = Figure(figsize=(11.5, 3.2 * len(settings)), dpi=110)
    grid = figure.subplots(len(settings), 2, squeeze=False, sharey="row")
    for row, setting in zip(grid, settings, strict=True):
        mine = [line for line in drawn if line.setting == setting]
        _draw(row[0], mine, colours, against_time=False)
        _draw(row[1], mine, colours, against_time=True)
        convention = mine[0].points[0].convention
        row[0].set_ylabel(f"{setting[0]} ({setting[1]})\nLPIPS x1000, {convention}")
        row[1].legend(fontsize=7, loc="upper left", bbox_to_anchor=(1, 1))
    grid[-1][0].set_xlabel("steps")
    grid[-1][1].set_xlabel("training seconds, category training not included")
    figure.tight_layout()
    figure.savefig(path)
    return True


def legend_of(line: Line) -> str:
    """What a line is, with the training that its time axis leaves out."""
    if line.category_seconds is None:
        return line.label
    return f"{line.label}\n(after {line.category_seconds:,.0f} s of category training)"


def _draw(
    axes: Axes, lines: Sequence[Line], colours: Mapping[str, str], *, against_time: bool
) -> None:
    for line in lines:
        places = [point.seconds if against_time else point.step for point in line.points]
        values = _distances(line)
        if values is not None:
            colour, name = colours[line.label], legend_of(line)
            axes.plot(places, values, marker="o", ms=3, lw=1.2, color=colour, label=name)
    axes.set_xscale("log")
    axes.grid(alpha=0.3)


def _distances(line: Line) -> list[float] | None:
    """LPIPS of every point; None where one was not measured."""
    values = [point.lpips_x1000 for point in line.points if point.lpips_x1000 is not None]
    return values if len(values) == len(line.points) else None
