"""What a training says while it runs: JSON lines, TensorBoard curves, a progress bar."""

import json
import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from torch.utils.tensorboard.writer import SummaryWriter
from tqdm import tqdm

from actorsnerf_train.checkpoint import write_whole

LOG = "log.jsonl"
CURVES = "tensorboard"
LINE_SECONDS = 20.0
"""Between two updates of the progress bar where it goes to a file."""


@dataclass(frozen=True)
class Entry:
    """One line of the log: means over the steps since the last line."""

    step: int
    actor: str
    """Of the last of these steps."""
    loss: float
    perceptual: float
    squared_error: float
    skinning: float
    inside: float
    outside: float
    survivors: float
    """Share of the ray samples that went through the networks."""
    rate_factor: float
    open_bands: float
    seconds: float
    """Training time so far."""


class Journal:
    """The log of a run; goes on where an interrupted run stopped.

    Only the leading process writes one: the others have it silent.
    """

    def __init__(self, run: Path | None, perceptual: str, first_step: int, steps: int) -> None:
        """A journal in `run`, or one that writes nothing where `run` is None."""
        self.perceptual = perceptual
        self.log = None
        self.curves = None
        if run is not None:
            keep_log_until(run / LOG, first_step)
            self.log = (run / LOG).open("a", encoding="utf-8")
            self.curves = SummaryWriter(str(run / CURVES), purge_step=first_step)
        self.bar = tqdm(
            initial=first_step,
            total=steps,
            unit="step",
            disable=run is None,
            mininterval=0.2 if sys.stderr.isatty() else LINE_SECONDS,
        )
        self.began = time.monotonic()
        self.apart = 0.0

    def __enter__(self) -> "Journal":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.bar.close()
        if self.log is not None:
            self.log.close()
        if self.curves is not None:
            self.curves.close()

    def seconds(self) -> float:
        """Since this process began to train, without what was `not_training`."""
        return time.monotonic() - self.began - self.apart

    @contextmanager
    def not_training(self) -> Iterator[None]:
        """What is done meanwhile takes no training time."""
        began = time.monotonic()
        yield
        self.apart += time.monotonic() - began

    def advance(self) -> None:
        """One step is done."""
        self.bar.update()

    def record(self, entry: Entry) -> None:
        """Log an entry everywhere; the perceptual term goes under its own name."""
        self.bar.set_postfix_str(
            f"{self.perceptual} {entry.perceptual:.3f}, mse {entry.squared_error:.4f}",
            refresh=False,
        )
        numbers = {
            "loss": entry.loss,
            self.perceptual: entry.perceptual,
            "mse": entry.squared_error,
            "skinning": entry.skinning,
            "alpha_inside": entry.inside,
            "alpha_outside": entry.outside,
            "survivors": entry.survivors,
            "rate_factor": entry.rate_factor,
            "open_bands": entry.open_bands,
            "seconds": entry.seconds,
        }
        finite = {k: v if math.isfinite(v) else None for k, v in numbers.items()}
        if self.log is not None:
            line = {"step": entry.step, "actor": entry.actor, **finite}
            self.log.write(json.dumps(line) + "\n")
            self.log.flush()
        if self.curves is not None:
            for name, value in finite.items():
                if value is not None:
                    self.curves.add_scalar(name, value, entry.step)


def keep_log_until(path: Path, step: int) -> None:
    """Drop the log's lines after a step: an interrupted run had gone past its last checkpoint."""
    if not path.is_file():
        return
    kept = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.endswith("}") and json.loads(line)["step"] <= step:  # else: cut off while writing
            kept.append(line + "\n")
    write_whole(path, "".join(kept).encode())
