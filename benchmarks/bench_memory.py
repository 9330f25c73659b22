"""Peak memory of one `official` category-training step and of one whole picture, on the CPU.

    python benchmarks/bench_memory.py [PREPARED.h5]

The file's crops are enlarged to about 512 pixels, so that sizes are the released ones whatever was
prepared; each case runs in a process of its own and reports the kernel's peak resident size. Writes
`benchmarks/results/memory.md`. Seed 0.
"""

import argparse
import resource
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import torch
import torch.nn.functional as F
from records import RESULTS, Table, record

from actorsnerf_datasets.torch_dataset import PretrainingDataset, Sample, View
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_model.render import render
from actorsnerf_model.states import Camera, RenderOptions
from actorsnerf_train.allocator import keep_memory
from actorsnerf_train.batches import jitter_generator
from actorsnerf_train.config import TrainConfig, pretraining
from actorsnerf_train.losses import LossWeights, Perceptual
from actorsnerf_train.lpips import load_lpips
from actorsnerf_train.methods import know_actor
from actorsnerf_train.objective import Objective

TARGET = 512
DEMO = RESULTS.parents[1] / "data" / "demo" / "prepared"
CASES = ("load", "step", "picture")
REMARK = (
    "All four patches lie on the person, the worst case for a step. `load` is the file and the "
    "libraries alone. Aims: 6 GB a step, 2 GB a picture."
)


def main() -> int:
    """Exit status 0 when every case ran."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path, nargs="?", help="any prepared file; `make demo`'s")
    parser.add_argument("--case", choices=CASES)
    arguments = parser.parse_args()
    found = sorted(DEMO.glob("*.h5"))
    file = arguments.file or (found[0] if found else None)
    if file is None:
        parser.error("no prepared file given, and none of the demonstration: run make demo")
    if arguments.case:
        print(_case(arguments.case, file))
        return 0
    rows = []
    for case in CASES:
        command = [sys.executable, __file__, str(file), "--case", case]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        found_case, peak, seconds, survivors = done.stdout.strip().splitlines()[-1].split()
        rows.append((found_case, float(peak), float(seconds), int(survivors)))
    table = Table(
        title="Untrained, float32",
        columns=("case", "peak memory, GB", "seconds", "samples through the networks"),
        rows=tuple(rows),
        remark=REMARK,
    )
    record("memory", "Peak memory of the `official` sizes", 0, (table,))
    return 0


def _case(case: str, file: Path) -> str:
    keep_memory()
    torch.manual_seed(0)
    config = pretraining("official")
    patches = config.patches
    sample = PretrainingDataset((file,), 0, config.model.views, patches.count, patches.side, 1)[0]
    factor = TARGET / max(sample.target.image.shape[:2])
    sample = Sample(
        _larger(sample.target, factor),
        tuple(_larger(view, factor) for view in sample.supports),
        sample.patches,
    )
    middle = (torch.tensor(sample.target.image.shape[1::-1]) // 2)[None, None]
    sample = replace(sample, patches=sample.patches - sample.patches.amin((1, 2), True) + middle)
    method = ActorsNeRF(config.model)
    started, survivors = time.monotonic(), 0
    if case == "step":
        survivors = _step(config, method, sample)
    if case == "picture":
        survivors = _picture(config, method, sample)
    seconds = time.monotonic() - started
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    return f"{case} {peak:.2f} {seconds:.1f} {survivors}"


def _larger(view: View, factor: float) -> View:
    def grown(picture: torch.Tensor) -> torch.Tensor:
        return F.interpolate(picture[None], scale_factor=factor, mode="bilinear")[0]

    K = view.K.clone()
    K[:2] *= factor
    K[:2, 2] += 0.5 * factor - 0.5
    image = grown(view.image.permute(2, 0, 1)).permute(1, 2, 0).contiguous()
    return replace(view, image=image, alpha=grown(view.alpha[None])[0], K=K)


def _step(config: TrainConfig, method: ActorsNeRF, sample: Sample) -> int:
    lpips = load_lpips()
    assert lpips is not None, "LPIPS weights are part of the step: run make setup"
    perceptual = Perceptual(lpips)
    # All samples learn, as those of a hazy actor would: the worst case.
    options = replace(config.render, least_learned=0.0)
    objective = Objective(method, perceptual, LossWeights(), options)
    optimiser = torch.optim.Adam(method.parameters())
    known = know_actor(method, sample.supports)
    outcome = objective(sample, known, 6.0, jitter_generator(0, 0, torch.device("cpu")))
    torch.autograd.backward(outcome.losses.total)
    optimiser.step()
    return int(outcome.counts.survivors)


@torch.no_grad()
def _picture(config: TrainConfig, method: ActorsNeRF, sample: Sample) -> int:
    method.eval()
    target = sample.target
    actor = method.actor_state(sample.supports, 6.0)
    pose = method.pose_state(actor, target.pose, target.rest_joints)
    height, width = target.image.shape[:2]
    camera = Camera(target.K, target.camera_from_body, (width, height))
    return render(method, actor, pose, camera, RenderOptions()).counts.survivors


if __name__ == "__main__":
    sys.exit(main())
