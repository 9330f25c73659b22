"""Time against error as a picture: what is worth using lies on the line."""

import io
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from actorsnerf_train.checkpoint import write_whole
from actorsnerf_train.report.rows import ActorReport, PointRow, SpeedReport

COLOURS = {"reference": "0.3", "exact": "tab:green", "stated": "tab:blue", "baked": "tab:orange"}
DPI = 110
CEILING = 100.0
"""Decibel at which the reference itself is drawn."""
DECADES = 300.0
"""Times whose axis spans less, as a ratio, have numbers at 1, 2 and 5."""
SLANT = 35.0
"""Degrees of the names, which would cover each other where points have the same error."""


def write_plot(path: Path, report: SpeedReport) -> None:
    """Write the Pareto plot, one panel an actor, as a PNG file."""
    count = len(report.actors)
    figure = Figure(figsize=(6.5 * count, 4.6))
    panels = figure.subplots(1, count, squeeze=False)
    for panel, actor in zip(panels[0], report.actors, strict=True):
        _draw(panel, actor)
    figure.tight_layout()
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=DPI, metadata={"Software": None})
    write_whole(path, stream.getvalue())


def _draw(panel: Axes, actor: ActorReport) -> None:
    for row in actor.points:
        place = (1e3 * row.seconds, _height(row))
        used = row.dominated_by is None
        colour = COLOURS[row.kind]
        panel.plot(*place, "o" if used else "x", color=colour, alpha=1.0 if used else 0.5)
        weight = "bold" if row.name == actor.recommended else "normal"
        panel.annotate(
            row.name,
            place,
            (3, 3),
            textcoords="offset points",
            fontsize=7,
            fontweight=weight,
            rotation=SLANT,
        )
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


def _height(row: PointRow) -> float:
    return CEILING if row.kind == "reference" else min(row.reference_psnr, CEILING)


__all__ = ["write_plot"]
