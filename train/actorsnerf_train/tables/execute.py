"""A planned run made, or gone on with: trained, and evaluated if it is of one actor."""

from pathlib import Path
from typing import Literal

from actorsnerf_datasets.types import ListName
from actorsnerf_train.config import PresetName
from actorsnerf_train.evaluate import EvaluateOptions, run_evaluate
from actorsnerf_train.fewshot import FewshotOptions, run_fewshot
from actorsnerf_train.options import Changes, Resources
from actorsnerf_train.pretrain import Part, PretrainOptions, run_pretrain
from actorsnerf_train.tables.plan import ABLATED, EVALUATION, Run


def execute(
    run: Run,
    preset: PresetName,
    list_name: ListName | None,
    use: Resources,
    max_frames: int | None,
) -> None:
    """Train the run to its end and evaluate it; what is done is not repeated.

    Args:
        run: of a plan.
        preset: of all trainings.
        list_name: of the few-shot frames.
        use: how to compute.
        max_frames: evaluation frames at most; None: the whole protocol.
    """
    change = Changes(steps=run.steps, seed=run.seed)
    if run.setting is None:
        without: tuple[Part, ...] = _without(run)
        run_pretrain(PretrainOptions(run.data, run.folder, preset, without, change=change, use=use))
        return
    (data,) = run.data
    category: Literal["scratch"] | Path = run.category or "scratch"
    method: Literal["actorsnerf", "humannerf"] = (
        "humannerf" if run.method == "humannerf" else "actorsnerf"
    )
    options = FewshotOptions(
        data, run.folder, category, run.setting, list_name, None, method, preset, change, use
    )
    run_fewshot(options)
    run_evaluate(
        EvaluateOptions(
            run.folder,
            data,
            run.folder / EVALUATION,
            max_frames=max_frames,
            lpips=use.lpips,
            device=use.device,
        )
    )


def _without(run: Run) -> tuple[Part, ...]:
    match ABLATED.get(run.method):
        case "deformation":
            return ("deformation",)
        case "pixel_features":
            return ("pixel_features",)
        case "body_features":
            return ("body_features",)
        case _:
            return ()
