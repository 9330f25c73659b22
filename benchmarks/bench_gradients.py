"""How exact a training step's gradients are: ours and the reference's, against float64.

Each stage's step on a fitted actor, as the report times it, with and without the perceptual term,
whose own gradient may turn on rounding. The truth is the reference renderer in float64: every
sample through every network, in the published order. Our step in float64 shows what the savings
themselves leave out, both steps in float32 what rounding adds. Samples are the report's.
Writes `results/gradients.md` and `.json`.
"""

import argparse
import copy
import dataclasses

import torch
from fitted import add_arguments, fitted_actor
from records import Table, record
from torch import Tensor

from actorsnerf_train.lpips import LpipsFiles
from actorsnerf_train.methods import know_actor
from actorsnerf_train.objective import Objective
from actorsnerf_train.options import ready_perceptual
from actorsnerf_train.report.reference_step import with_tensors
from actorsnerf_train.report.training import STAGES, Step, largest_error, make_step

SEED = 0
Gradients = dict[str, Tensor]


def in_double(tensor: Tensor) -> Tensor:
    """The tensor in float64, if it is one of float32."""
    return tensor.double() if tensor.dtype == torch.float32 else tensor


def double_step(step: Step) -> Step:
    """The step's twin in float64, of copied weights."""
    old = step.objective
    method = copy.deepcopy(old.method).double()
    perceptual = copy.deepcopy(old.perceptual).double()
    sample = with_tensors(step.sample, in_double)
    return dataclasses.replace(
        step,
        objective=Objective(method, perceptual, old.weights, old.options),
        sample=sample,
        known=know_actor(method, sample.supports),
    )


def ours(step: Step) -> Gradients:
    """The trainings' own gradients, in float64."""
    step.ours()
    return in_float64(step.gradients())


def reference(step: Step) -> Gradients:
    """The reference's, in float64."""
    step.reference()
    return in_float64(step.gradients())


def in_float64(gradients: Gradients) -> Gradients:
    """The same numbers."""
    return {name: gradient.double() for name, gradient in gradients.items()}


def row(step: Step, what: str) -> tuple[str | float, ...]:
    """Largest relative L2 errors over the parameters."""
    double = double_step(step)
    truth, exact, slow, fast = reference(double), ours(double), reference(step), ours(step)
    pairs = [
        largest_error(exact, truth),
        largest_error(fast, slow),
        largest_error(fast, truth),
        largest_error(slow, truth),
    ]
    return step.stage, what, *(f"{error:.1e} ({name})" for name, error in pairs)


def main() -> None:
    """Compares and writes."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_arguments(parser, samples=128)
    options = parser.parse_args()
    trained = fitted_actor(options)
    if trained is None:
        return
    perceptual = ready_perceptual(LpipsFiles())
    rows = []
    count = side = 0
    for stage in STAGES:
        step = make_step(stage, trained, options.data, perceptual, SEED)
        count, side = step.sample.patches.shape[:2]
        rows.append(row(step, f"{perceptual.name} and squared error"))
        plain = copy.copy(step.objective)
        plain.weights = dataclasses.replace(plain.weights, perceptual=0.0)
        rows.append(row(dataclasses.replace(step, objective=plain), "squared error alone"))
        print(*rows[-2:], sep="\n", flush=True)
    columns = (
        "stage",
        "loss",
        "ours in float64, from the reference in float64",
        "ours, from the reference in float32",
        "ours, from float64",
        "the reference in float32, from float64",
    )
    remark = (
        f"{trained.actor}, `{trained.config.preset}` sizes, {count} patches of {side}x{side} "
        f"pixels, {options.samples} samples a ray: the largest relative L2 error over all "
        "parameters, and whose it is."
    )
    record(
        "gradients",
        "Gradients of a training step",
        SEED,
        [Table("Largest errors", columns, tuple(rows), remark)],
    )


if __name__ == "__main__":
    torch.set_num_threads(1)
    main()
