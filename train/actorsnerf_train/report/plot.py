"""Time against error as a picture: what is worth using lies on the line."""

import io
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text
from matplotlib.ticker import LogLocator, NullFormatter
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from actorsnerf_train.checkpoint import write_whole
from actorsnerf_train.report.rows import ActorReport, PointRow, SpeedReport

COLOURS = {"reference": "0.3", "exact": "tab:green", "stated": "tab:blue", "baked": "tab:orange"}
DPI = 110
CEILING = 100.0
"""Decibel at which the reference itself is drawn."""
DECADES = 300.0
"""Times whose axis spans less, as a ratio, have numbers at 1, 2 and 5."""
DISTANCES = (6.0, 14.0, 26.0, 40.0, 56.0)
"""Of a name from its point, in points of print; the first that leaves it readable is taken."""
SIDES = (
    (1.0, 0.0),
    (-1.0, 0.0),
    (0.0, 1.0),
    (0.0, -1.0),
    (0.7, 0.7),
    (-0.7, -0.7),
    (-0.7, 0.7),
    (0.7, -0.7),
)
"""Where a name may stand, right and up counted as positive."""
MARK = 8.0
"""Edge of the square that a point's mark covers, in pixels."""


def write_plot(path: Path, report: SpeedReport) -> None:
    """Write the Pareto plot as a PNG file."""
    stream = io.BytesIO()
    pareto_plot(report).savefig(stream, format="png", dpi=DPI, metadata={"Software": None})
    write_whole(path, stream.getvalue())


def pareto_plot(report: SpeedReport) -> Figure:
    """Time against error, one panel an actor."""
    count = len(report.actors)
    figure = Figure(figsize=(6.5 * count, 4.6), dpi=DPI)
    renderer = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    panels = figure.subplots(1, count, squeeze=False)
    for panel, actor in zip(panels[0], report.actors, strict=True):
        _draw(panel, actor)
    figure.tight_layout()
    for panel, actor in zip(panels[0], report.actors, strict=True):
        _write_names(panel, actor, renderer)
    return figure


def _draw(panel: Axes, actor: ActorReport) -> None:
    for row in actor.points:
        place = (1e3 * row.seconds, _height(row))
        used = row.dominated_by is None
        colour = COLOURS[row.kind]
        panel.plot(*place, "o" if used else "x", color=colour, alpha=1.0 if used else 0.5)
    front = sorted((1e3 * r.seconds, _height(r)) for r in actor.points if r.dominated_by is None)
    panel.plot(*zip(*front, strict=True), "-", color="0.75", zorder=0)
    panel.set_xscale("log")
    panel.margins(x=0.12, y=0.2)
    low, high = panel.get_xlim()
    if high < DECADES * low:  # decades alone would leave one number or none
        panel.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.set_minor_formatter(NullFormatter())
    panel.set_xlabel("ms a frame")
    panel.set_ylabel("dB to the reference picture in the box")
    width, height = actor.size
    panel.set_title(f"{actor.actor}: {actor.method}, {actor.preset}, {width}x{height}", fontsize=9)
    panel.grid(True, which="both", alpha=0.25)


def _write_names(panel: Axes, actor: ActorReport, renderer: RendererAgg) -> None:
    """Each point's name beside it, where it covers no mark and no other name."""
    places = [(1e3 * row.seconds, _height(row)) for row in actor.points]
    taken = [Bbox.from_extents(*(at - MARK / 2), *(at + MARK / 2)) for at in _pixels(panel, places)]
    for row, place in zip(actor.points, places, strict=True):
        weight = "bold" if row.name == actor.recommended else "normal"
        for distance in DISTANCES:
            tried = [_written(panel, (row.name, weight), place, side, distance) for side in SIDES]
            free = [one for one in tried if _fits(panel, one, taken, renderer)]
            kept = free[0] if free else tried[0] if distance == DISTANCES[-1] else None
            for one in tried:
                if one is not kept:
                    one.remove()
            if kept is not None:
                taken.append(covered(kept, renderer))
                break


def _pixels(panel: Axes, places: list[tuple[float, float]]) -> NDArray[np.float64]:
    pixels: NDArray[np.float64] = panel.transData.transform(places)
    return pixels


def _written(
    panel: Axes,
    name: tuple[str, str],
    place: tuple[float, float],
    side: tuple[float, float],
    distance: float,
) -> Annotation:
    """A name and its weight at a distance from its place, with a line to it unless it is near."""
    line = {"arrowstyle": "-", "color": "0.7", "lw": 0.5, "shrinkA": 0, "shrinkB": 3}
    return panel.annotate(
        name[0],
        place,
        (side[0] * distance, side[1] * distance),
        textcoords="offset points",
        fontsize=7,
        fontweight=name[1],
        horizontalalignment={1: "left", 0: "center", -1: "right"}[_sign(side[0])],
        verticalalignment={1: "bottom", 0: "center", -1: "top"}[_sign(side[1])],
        arrowprops=line if distance > DISTANCES[0] else None,
    )


def covered(text: Annotation, renderer: RendererAgg) -> Bbox:
    """What the words cover, in pixels; their line counts as nothing."""
    text.update_positions(renderer)
    return Text.get_window_extent(text)


def _fits(panel: Axes, text: Annotation, taken: list[Bbox], renderer: RendererAgg) -> bool:
    """Whether the text lies in the panel and covers nothing."""
    box, whole = covered(text, renderer), panel.get_window_extent()
    inside = whole.x0 <= box.x0 and box.x1 <= whole.x1 and whole.y0 <= box.y0 and box.y1 <= whole.y1
    return bool(inside) and box.count_overlaps(taken) == 0


def _sign(value: float) -> int:
    return (value > 0) - (value < 0)


def _height(row: PointRow) -> float:
    return CEILING if row.kind == "reference" else min(row.reference_psnr, CEILING)


__all__ = ["covered", "pareto_plot", "write_plot"]
