"""The command line: pretrain, fewshot, evaluate, render, bake, stability, report, tables."""

import inspect
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.shell import quoted
from actorsnerf_train.allocator import keep_memory
from actorsnerf_train.animate import AnimateOptions, run_render
from actorsnerf_train.bake import BakeCommand, run_bake
from actorsnerf_train.distributed import refuse_company
from actorsnerf_train.evaluate import EvaluateOptions, run_evaluate
from actorsnerf_train.fewshot import FewshotOptions, run_fewshot
from actorsnerf_train.pretrain import PretrainOptions, run_pretrain
from actorsnerf_train.report.command import ReportOptions, run_report
from actorsnerf_train.stability.command import StabilityOptions, UnstableError, run_stability
from actorsnerf_train.tables.command import run_tables
from actorsnerf_train.tables.options import TablesOptions

DESCRIPTION = """Train, evaluate and animate people from prepared files.

  pretrain   learn what all actors share, from many prepared files
  fewshot    fit one unseen actor from a few of its pictures
  evaluate   measure the fitted actor in unseen poses and views
  render     turntables, new poses, meshes; needs no data file
  bake       one small file that evaluate and render take too, drawn many times a second
  stability  try hard cases on any checkpoint; a table of errors and verdicts
  report     what each named saving gains in time and costs in error, measured
  tables     the paper's tables: plans the runs, makes those missing, writes Markdown, CSV, LaTeX

Prepared files come from: python -m actorsnerf_preprocess prepare --help
Several GPUs (pretrain and fewshot only):
  torchrun --nproc-per-node 4 -m -- actorsnerf_train pretrain --device cuda ...
"""
INTERRUPTED = 130
"""Exit status of a program that Ctrl-C stopped."""


@dataclass(frozen=True)
class _Fewshot(FewshotOptions):
    """The options of a fitting; on the command line `category` is called --from."""

    category: Annotated[Literal["scratch"] | Path, tyro.conf.arg(name="from")]
    """Run folder or checkpoint of the category training; "scratch" begins from random weights and
    trains every part, to compare with."""


Options = (
    Annotated[PretrainOptions, tyro.conf.subcommand("pretrain")]
    | Annotated[
        _Fewshot, tyro.conf.subcommand("fewshot", description=inspect.getdoc(FewshotOptions))
    ]
    | Annotated[EvaluateOptions, tyro.conf.subcommand("evaluate")]
    | Annotated[AnimateOptions, tyro.conf.subcommand("render")]
    | Annotated[BakeCommand, tyro.conf.subcommand("bake")]
    | Annotated[StabilityOptions, tyro.conf.subcommand("stability")]
    | Annotated[ReportOptions, tyro.conf.subcommand("report")]
    | Annotated[TablesOptions, tyro.conf.subcommand("tables")]
)


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 done, 2 something outside the program is wrong, 130 stopped by Ctrl-C.

    1: a hard case of `stability` is out of its bounds.
    """
    keep_memory()
    options = tyro.cli(
        Options,
        prog="python -m actorsnerf_train",
        description=DESCRIPTION,
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes,),
    )
    try:
        told = _run(options)
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"error: {_refused_by_disk(error)}", file=sys.stderr)
        return 2
    except UnstableError as failure:
        print(*failure.lines, sep="\n")
        return 1
    except KeyboardInterrupt:
        again = isinstance(options, PretrainOptions | FewshotOptions | TablesOptions)
        goes_on = "; the same command goes on from the last checkpoint" if again else ""
        print(f"stopped{goes_on}", file=sys.stderr)
        return INTERRUPTED
    if os.environ.get("RANK", "0") == "0":  # one process of torchrun's speaks
        print(*told, sep="\n")
    return 0


def _refused_by_disk(error: OSError) -> str:
    """A full disk, a read-only folder, a file where a folder should be: which, and where."""
    place = "" if error.filename is None else f"{error.filename}: "
    return (
        f"{place}{error.strerror or error}: make room, or name a place that can be written; a "
        "training's last checkpoint is kept."
    )


def _run(
    options: (
        PretrainOptions
        | FewshotOptions
        | EvaluateOptions
        | AnimateOptions
        | BakeCommand
        | StabilityOptions
        | TablesOptions
        | ReportOptions
    ),
) -> tuple[str, ...]:
    """What to tell when the command is done."""
    program = "python -m actorsnerf_train"
    if not isinstance(options, PretrainOptions | FewshotOptions):
        refuse_company()
    match options:
        case PretrainOptions():
            return (
                f"checkpoint: {run_pretrain(options)}",
                f"next: {program} fewshot --data HELD_OUT_ACTOR.h5 --from {quoted(options.run)} "
                "--run FOLDER",
            )
        case FewshotOptions():
            run, data = quoted(options.run), quoted(options.data)
            return (
                f"checkpoint: {run_fewshot(options)}",
                f"next: {program} evaluate --checkpoint {run} --data {data} "
                f"--out {quoted(options.run / 'evaluation')}",
                f"  or: {program} render --checkpoint {run} "
                f"--out {quoted(options.run / 'turntable')}",
            )
        case EvaluateOptions():
            run_evaluate(options)
            return (f"result: {options.out / 'result.md'}",)
        case AnimateOptions():
            return tuple(map(str, run_render(options)))
        case BakeCommand():
            return run_bake(options)
        case TablesOptions():
            return run_tables(options)
        case StabilityOptions():
            return run_stability(options)
        case ReportOptions():
            return run_report(options)


if __name__ == "__main__":
    sys.exit(main())
