"""How long a training step takes against the reference's, and whether both learn the same.

The steps that `actorsnerf_train report` measures, alone: the report has them after half an hour of
frames. Wants the machine to itself. Writes `results/steps.md` and `.json`.
"""

import argparse

import torch
from fitted import add_arguments, fitted_actor
from records import Table, record

from actorsnerf_train.allocator import keep_memory
from actorsnerf_train.lpips import LpipsFiles
from actorsnerf_train.options import ready_perceptual
from actorsnerf_train.report.measure import Spread
from actorsnerf_train.report.training import training_rows

SEED = 0


def seconds(spread: Spread) -> str:
    """Median (quartiles)."""
    return f"{spread.median:.2f} ({spread.low:.2f}-{spread.high:.2f})"


def main() -> None:
    """Measures and writes."""
    parser = argparse.ArgumentParser(description=__doc__)
    add_arguments(parser, samples=128)
    parser.add_argument("--rounds", type=int, default=3, help="in turns")
    options = parser.parse_args()
    trained = fitted_actor(options)
    if trained is None:
        return
    perceptual = ready_perceptual(LpipsFiles())
    rows = training_rows(trained, options.data, perceptual, options.rounds, SEED)
    columns = (
        "stage",
        "s a step",
        "reference, s",
        "x reference",
        "loss differs by",
        "largest relative L2 error of a gradient",
    )
    values = tuple(
        (
            row.stage,
            seconds(row.seconds),
            seconds(row.reference_seconds),
            f"{row.faster:.1f}",
            f"{row.loss_difference:.1e}",
            f"{row.gradient_error:.1e} ({row.worst_parameter})",
        )
        for row in rows
    )
    remark = (
        f"{trained.actor}, `{trained.config.preset}` sizes, {rows[0].patches} patches of "
        f"{rows[0].side}x{rows[0].side} pixels, {options.samples} samples a ray, one thread; "
        f"medians (quartiles) of {options.rounds} rounds in turns, wall times."
    )
    table = Table("Against the reference", columns, values, remark)
    record("steps", "A training step", SEED, [table])


if __name__ == "__main__":
    keep_memory()
    torch.set_num_threads(1)
    main()
