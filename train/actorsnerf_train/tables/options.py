"""What the tables are asked for: the `tables` command's options, and the rows that it knows."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from actorsnerf_datasets.types import ListName
from actorsnerf_train.config import MethodName, PresetName
from actorsnerf_train.metrics import ConventionName
from actorsnerf_train.options import Resources
from actorsnerf_train.pretrain import Part

MethodRow = Literal[
    "actorsnerf",
    "scratch",
    "humannerf",
    "neuralbody",
    "no-deformation",
    "no-pixel-features",
    "no-body-features",
]
"""scratch: ActorsNeRF without its category; no-...: the paper's ablations, in both trainings."""
ABLATED: dict[MethodRow, Part] = {
    "no-deformation": "deformation",
    "no-pixel-features": "pixel_features",
    "no-body-features": "body_features",
}
BASELINES: dict[MethodRow, MethodName] = {"humannerf": "humannerf", "neuralbody": "neuralbody"}
"""Rows of other methods; the rest are ActorsNeRF's."""
WITHOUT_CATEGORY: tuple[MethodRow, ...] = ("scratch", *BASELINES)


def method_of(row: MethodRow) -> MethodName:
    """The method that a row is of.

    >>> method_of("scratch"), method_of("humannerf")
    ('actorsnerf', 'humannerf')
    """
    return BASELINES.get(row, "actorsnerf")


@dataclass(frozen=True)
class TablesOptions:
    """Fills the paper's tables: plans the runs, makes those that are missing, writes the tables.

    Killed? The same command goes on. Without --data nothing is trained: the results below --out
    and --results become tables.
    """

    out: Path
    """Folder for the runs (runs/) and the tables (.md, .csv, .tex, .png)."""
    data: tuple[Path, ...] = ()
    """Prepared files or folders of them; held-out actors are tested, the others pre-train."""
    results: tuple[Path, ...] = ()
    """More result.json files, or folders with some, e.g. recorded ones of another machine; what
    they stand for is not trained again."""
    preset: PresetName = "small"
    """Of all trainings."""
    trunk_file: Path | None = None
    """ImageNet weights that ActorsNeRF's encoder begins from where the preset asks for them:
    torchvision's resnet18-f37072fd.pth (official)."""
    methods: tuple[MethodRow, ...] = ("actorsnerf", "humannerf", "neuralbody")
    """Rows; scratch: ActorsNeRF without category; no-...: ablations in both trainings."""
    settings: tuple[str, ...] = ("fewshot-5", "fewshot-10", "fewshot-30", "short-video")
    """Few-shot settings that every held-out file must have."""
    list: ListName | None = None
    """official or auto frames; left out: official where the file has them."""
    seeds: tuple[int, ...] = (0,)
    """Of the few-shot trainings; their spread is reported."""
    category_seed: int = 0
    """Of the category trainings, whatever the seeds of the few-shot ones."""
    steps: int | None = None
    """Of each few-shot training; the preset's if left out."""
    pretrain_steps: int | None = None
    """Of each category training; the preset's if left out."""
    conventions: tuple[ConventionName, ...] = ("paper", "box")
    """One table each."""
    max_frames: int | None = None
    """Evaluation frames at most, evenly spread, for a quick look."""
    dry_run: bool = False
    """Show the plan, with the time that it will take, and stop."""
    use: Resources = field(default_factory=Resources)
    """How to compute."""
