from dataclasses import replace
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Annotation

from actorsnerf_train.pictures import read_png
from actorsnerf_train.report.plot import covered, pareto_plot, write_plot
from actorsnerf_train.report.rows import SpeedReport


def test_the_plot_is_a_picture_and_the_same_every_time(report: SpeedReport, tmp_path: Path) -> None:
    write_plot(tmp_path / "a.png", report)
    write_plot(tmp_path / "b.png", report)
    picture = read_png(tmp_path / "a.png")
    assert picture.shape[0] > 300 and picture.std() > 5
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_names_cover_no_other_name(report: SpeedReport) -> None:
    """Even where eight points lie in one place."""
    (actor,) = report.actors
    row = replace(actor.points[-1], kind="stated", reference_psnr=40.0)
    points = [replace(row, name=f"point {i}", seconds=0.1) for i in range(8)]
    points.append(replace(row, name="far away", seconds=10.0))
    figure = pareto_plot(replace(report, actors=(replace(actor, points=tuple(points)),)))
    renderer = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    names = [text for text in figure.axes[0].texts if isinstance(text, Annotation)]
    assert [name.get_text() for name in names] == [row.name for row in points]
    boxes = [covered(name, renderer) for name in names]
    for i, box in enumerate(boxes):
        assert box.count_overlaps(boxes[:i]) == 0
