"""How much memory one frame needs at an operating point: a process of its own draws it."""

import ctypes
import gc
import math
import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import torch

from actorsnerf_datasets.reader import SequenceFile
from actorsnerf_train.report.contestants import contestant_of
from actorsnerf_train.report.frames import report_frames
from actorsnerf_train.report.measure import Effort, draw
from actorsnerf_train.report.points import OperatingPoint
from actorsnerf_train.trained import load_actor, resampled

STATUS = Path("/proc/self/status")
REFERENCES = Path("/proc/self/clear_refs")
FORGET_PEAK = "5"
"""Written there, it makes the kernel count the largest resident size anew."""


@dataclass(frozen=True)
class MemoryJob:
    """One frame to draw."""

    source: Path
    """Checkpoint, or baked file."""
    data: Path
    point: OperatingPoint | None
    """None: as a baked file draws it."""
    samples: int | None
    """Per ray; None: the actor's own."""
    effort: Effort
    threads: int
    device: str


def peak_memory(jobs: Sequence[MemoryJob]) -> tuple[float | None, ...]:
    """Megabytes that each job's frame needs at its peak, beyond the loaded program and actor.

    Each runs alone in a process of its own. On a CPU it is the kernel's largest resident size less
    the one before the frame (Linux; None elsewhere), on CUDA torch's own count.
    """
    found: list[float | None] = []
    for job in jobs:
        fresh = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(1, mp_context=fresh) as process:
            found.append(process.submit(frame_memory, job).result())
    return tuple(found)


def frame_memory(job: MemoryJob) -> float | None:
    """What `peak_memory` runs in the other process."""
    torch.set_num_threads(job.threads)
    device = torch.device(job.device)
    trained = resampled(load_actor(job.source, device), job.samples)
    with SequenceFile(job.data) as file:
        frame = report_frames(trained, file, 1, 1)[0]
    contestant = contestant_of(trained, job.point)
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)
        allocated = torch.cuda.memory_allocated(device)
        draw(contestant, frame, job.effort)
        return float(torch.cuda.max_memory_allocated(device) - allocated) / 1e6
    if not _forget_peak():
        return None
    before = _peak()
    draw(contestant, frame, job.effort)
    return _peak() - before


def _forget_peak() -> bool:
    """Whether the kernel's largest resident size now is the present one."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)  # what loading has freed is no part of the frame
    try:
        REFERENCES.write_text(FORGET_PEAK)
    except OSError:
        return False
    return True


def _peak() -> float:
    """The largest resident size of this process, megabytes."""
    for line in STATUS.read_text().splitlines():
        if line.startswith("VmHWM:"):
            return float(line.split()[1]) * 1.024e-3  # of KiB
    return math.nan


__all__ = ["MemoryJob", "frame_memory", "peak_memory"]
