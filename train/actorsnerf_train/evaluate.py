"""A protocol's unseen poses and views rendered and compared with the truth."""

from dataclasses import dataclass
from pathlib import Path

from actorsnerf_train.metrics import ConventionName
from actorsnerf_train.result import Evaluation


@dataclass(frozen=True)
class EvaluateOptions:
    """Renders a protocol's evaluation frames and cameras and measures them."""

    checkpoint: Path
    """Few-shot checkpoint (its folder)."""
    data: Path
    """Prepared file of the same actor."""
    out: Path
    """Folder for result.json, result.md and strip.png."""
    protocol: str | None = None
    """Named protocol of the file; may be left out where it has one only."""
    conventions: tuple[ConventionName, ...] = ("paper", "strict", "box")
    """What the pictures are compared on (see metrics.py)."""
    max_frames: int | None = None
    """For a quick look: at most this many frames, evenly spread; the result says so."""
    max_cameras: int | None = None
    """For a quick look: at most this many cameras, evenly spread; the result says so."""
    strip: int = 6
    """Rows (truth | prediction | error) of the picture strip; 0 writes none."""
    samples: int | None = None
    """Samples per ray; the checkpoint's own if left out."""
    stop_transmittance: float = 0.0
    """Stop a ray once less light than this passes; 0 = never (exact)."""
    lpips_weights: Path | None = None
    """VGG-16 weights for LPIPS; by default those that `make setup` installed."""
    device: str = "cpu"
    """cpu, cuda, cuda:1, ..."""


def run_evaluate(options: EvaluateOptions) -> Evaluation:
    """The evaluation, after result.json, result.md and strip.png were written to `options.out`.

    Raises:
        UserError: no such checkpoint, file or protocol; another actor; no evaluation picture.
    """
    raise NotImplementedError(options)
