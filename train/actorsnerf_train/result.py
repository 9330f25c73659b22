"""`result.json`: what one evaluation found, and everything one must know to believe it.

Tables and reports read this file and nothing else. It is one flat JSON object (schema 2; 1
lacked category_seconds, strip and curve):

=================== ===================================================================
key                 value
=================== ===================================================================
schema              "actorsnerf-result"
schema_version      2; a reader refuses a higher one
method              "actorsnerf", "humannerf" or "neuralbody"; baked: "actorsnerf-baked"
preset              of the training: "official", "small", ...
actor, sequence     who was rendered, from which sequence
dataset             "zju-mocap", "aist++", "synthetic" or "converted"
data_sha256         digest of the prepared file
protocol            name of the protocol in that file, e.g. "actorsnerf-zju"
setting, list_name  e.g. "fewshot-10" and "official" or "auto"; null if not few-shot
shots               number of training frames M; null if not few-shot
supports            number of support frames K
frames, cameras     evaluated frame numbers and camera names
limited             true if the protocol has more frames or cameras than were evaluated
missing             (camera, frame) pairs of those that the file holds no valid picture of
background          red, green, blue in [0, 1] that both pictures lie on
encoder             name of the image encoder; null if the method has none
encoder_pretrained  true if it started from published weights
pretrained_from     digest of the category-level checkpoint; null: from scratch
seed, step          of the training
training_seconds    of that training, category training not included
configuration       the training's configuration, an object
checkpoint          path as given
render_options      samples, threshold, ... as in `RenderOptions`, an object
lpips_note          why LPIPS is null; null where it was computed
machine             {"device", "processor", "cores", "threads", "torch", "platform"}
commit              of the program; null outside a checkout; ends in "+" with local changes
time                end of the evaluation, UTC, ISO 8601
seconds             of the whole evaluation
render_seconds      mean per picture, rendering alone
means               rows {convention, psnr, ssim, lpips_x1000}: mean over all pictures
per_camera          rows {camera, convention, psnr, ssim, lpips_x1000}: mean over frames
per_image           rows {camera, frame, convention, psnr, ssim, lpips_x1000, seconds}
baked               how a baked actor was made: {"options": {"voxel" in metres, ...}, "report",
                    "checkpoint", ...}; null if it is not baked
category_seconds    of the category training that it began from; null: from scratch, or not recorded
strip               where the pictures of strip.png lie: {"cell": [width, height], "gap", "columns",
                    "rows": [{camera, frame, width, height}]}, pixels; null without a strip
curve               error against time while it was fitted, rows {step, seconds, convention, psnr,
                    ssim, lpips_x1000, pictures}: mean over the few (camera, frame) pictures named;
                    seconds of training; null if it was not measured. Nothing was chosen by it
point               named operating point that drew the pictures, e.g. "fast" (`report/points.py`);
                    null: every sample that matters, or recorded before points were
=================== ===================================================================

PSNR in decibel (at most 100: equal pictures), LPIPS times 1000 or null. `metrics.py` defines the
conventions.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.metrics import ConventionName

SCHEMA = "actorsnerf-result"
SCHEMA_VERSION = 2

if TYPE_CHECKING:
    Json = None | bool | int | float | str | list["Json"] | dict[str, "Json"]
else:
    Json = object  # run-time type checkers cannot follow an alias into itself


@dataclass(frozen=True)
class MeanRow:
    """Mean over all pictures under one convention."""

    convention: ConventionName
    psnr: float
    ssim: float
    lpips_x1000: float | None


@dataclass(frozen=True)
class CameraRow:
    """Mean over the frames of one camera under one convention."""

    camera: str
    convention: ConventionName
    psnr: float
    ssim: float
    lpips_x1000: float | None


@dataclass(frozen=True)
class ImageRow:
    """One picture under one convention."""

    camera: str
    frame: int
    convention: ConventionName
    psnr: float
    ssim: float
    lpips_x1000: float | None
    seconds: float
    """Rendering alone."""


@dataclass(frozen=True)
class StripRow:
    """One row of the picture strip: an evaluation picture."""

    camera: str
    frame: int
    width: int
    """Pixels of each of its pictures, which lie top left in their cells."""
    height: int


@dataclass(frozen=True)
class StripLayout:
    """Where the pictures of `strip.png` lie."""

    cell: tuple[int, int]
    """Width and height."""
    gap: int
    """Between cells."""
    columns: tuple[str, ...]
    rows: tuple[StripRow, ...]


@dataclass(frozen=True)
class CurvePoint:
    """How good a fitting was after some steps: the mean over a few evaluation pictures."""

    step: int
    seconds: float
    """Training time so far; what measuring took is not in it."""
    convention: ConventionName
    psnr: float
    ssim: float
    lpips_x1000: float | None
    pictures: tuple[tuple[str, int], ...]
    """(camera, frame number)."""


@dataclass(frozen=True)
class Evaluation:
    """The content of one `result.json`; the module's docstring explains each field."""

    method: str
    preset: str
    actor: str
    sequence: str
    dataset: str
    data_sha256: str
    protocol: str
    setting: str | None
    list_name: str | None
    shots: int | None
    supports: int
    frames: tuple[int, ...]
    cameras: tuple[str, ...]
    limited: bool
    missing: tuple[tuple[str, int], ...]
    background: tuple[float, float, float]
    encoder: str | None
    encoder_pretrained: bool
    pretrained_from: str | None
    seed: int
    step: int
    training_seconds: float
    configuration: Mapping[str, Json]
    checkpoint: str
    render_options: Mapping[str, Json]
    lpips_note: str | None
    machine: Mapping[str, Json]
    commit: str | None
    time: str
    seconds: float
    render_seconds: float
    means: tuple[MeanRow, ...]
    per_camera: tuple[CameraRow, ...]
    per_image: tuple[ImageRow, ...]
    baked: Mapping[str, Json] | None = None
    category_seconds: float | None = None
    strip: StripLayout | None = None
    curve: tuple[CurvePoint, ...] | None = None
    point: str | None = None

    def mean(self, convention: ConventionName) -> MeanRow:
        """The actor's mean under a convention.

        Raises:
            UserError: it was not evaluated.
        """
        for row in self.means:
            if row.convention == convention:
                return row
        has = ", ".join(row.convention for row in self.means)
        raise UserError(
            f"the result of actor {self.actor} has no figures under the convention {convention} "
            f"(it has {has}): choose another, or evaluate again."
        )
