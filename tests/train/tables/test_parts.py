import csv
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from tests.train.tables.configured import without

from actorsnerf_train.tables.entry import gather
from actorsnerf_train.tables.parts import part_gains, write_parts

if TYPE_CHECKING:
    from tests.train.tables.conftest import WriteResult

BARE = without("deformation")


def pair(
    write: "WriteResult", seed: int, whole: float, bare: float | None, seconds: float = 80.0
) -> None:
    """Trainings of one seed with the deformation (100 s for 500 steps) and without."""
    write((25.0, 0.9, whole), seed=seed)
    write((25.0, 0.9, bare), seed=seed, configuration=BARE, training_seconds=seconds)


def test_gains_are_means_over_pairs(write: "WriteResult", tmp_path: Path) -> None:
    for seed, bare in enumerate((52.0, 54.0, 49.0)):
        pair(write, seed, 50.0, bare)
    write((25.0, 0.9, 1.0), seed=7, configuration=BARE)  # no mate
    write((25.0, 0.9, 1.0), seed=0, configuration=BARE, setting="short-video")  # nor here
    (gain,) = part_gains(gather([tmp_path]), "box")
    assert (gain.part, gain.setting, gain.list_name) == ("deformation", "fewshot-5", "official")
    assert gain.gain.value == pytest.approx(5 / 3)
    assert gain.gain.spread == pytest.approx((19 / 3) ** 0.5)  # of 2, 4, -1
    assert gain.share == pytest.approx(5 / 155)
    assert (gain.better, gain.pairs) == (2, 3)
    assert (gain.seconds_with, gain.seconds_without) == pytest.approx((0.2, 0.16))
    assert not gain.clear


@pytest.mark.parametrize(
    ("errors", "verdict"),
    [
        ((60.0, 61.0, 62.0), "pays"),
        ((52.0, 54.0, 59.0), "within noise"),  # 5.0 against 4.30 x 3.6 / sqrt(3)
        ((52.0, 54.0, 59.0, 56.0, 53.0), "pays"),  # 4.8 against 2.78 x 2.8 / sqrt(5)
        ((45.0, 44.0, 43.0), "harms"),
        ((60.0, 45.0, 51.0), "within noise"),
        ((60.0,), "too few pairs to tell (under 3)"),
        ((60.0, 60.1), "too few pairs to tell (under 3)"),
    ],
)
def test_the_verdict_looks_at_the_spread(
    write: "WriteResult", tmp_path: Path, errors: tuple[float, ...], verdict: str
) -> None:
    for seed, bare in enumerate(errors):
        pair(write, seed, 50.0, bare)
    gains = part_gains(gather([tmp_path / "results"]), "box")
    write_parts(tmp_path / "parts.md", gains, "box")
    assert (tmp_path / "parts.md").read_text().splitlines()[-1].endswith(f"| {verdict} |")


def test_both_files(write: "WriteResult", tmp_path: Path) -> None:
    for seed, bare in enumerate((60.0, 62.0)):
        pair(write, seed, 50.0, bare)
    write((25.0, 0.9, 75.0), pretrained_from=None)
    gains = part_gains(gather([tmp_path / "results"]), "box")
    write_parts(tmp_path / "parts.md", gains, "box")
    lines = (tmp_path / "parts.md").read_text().splitlines()
    assert lines[4] == (
        "| deformation | fewshot-5 | official | +11.0 ± 1.4 | +18.0% | 2 of 2 | "
        "0.20 with, 0.16 without | too few pairs to tell (under 3) |"
    )
    assert lines[5].startswith("| category training | fewshot-5 | official | +25.0 | +33.3% |")
    rows = list(csv.DictReader((tmp_path / "parts.csv").read_text().splitlines()))
    assert [row["part"] for row in rows] == ["deformation", "category training"]
    assert (float(rows[0]["gain"]), rows[0]["pairs"], rows[1]["spread"]) == (11.0, "2", "")


def test_without_lpips_nothing_is_gained(write: "WriteResult", tmp_path: Path) -> None:
    pair(write, 0, 50.0, None)
    assert part_gains(gather([tmp_path]), "box") == ()
