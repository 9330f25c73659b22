"""A planned run made, or gone on with: trained, and evaluated if it is of one actor."""

from actorsnerf_datasets.types import ListName
from actorsnerf_train.config import PresetName
from actorsnerf_train.evaluate import EvaluateOptions, run_evaluate
from actorsnerf_train.fewshot import FewshotOptions, run_fewshot
from actorsnerf_train.options import Changes, Resources
from actorsnerf_train.pretrain import PretrainOptions, run_pretrain
from actorsnerf_train.tables.options import ABLATED, METHODS
from actorsnerf_train.tables.plan import EVALUATION, Run


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
        without = (ABLATED[run.method],) if run.method in ABLATED else ()
        run_pretrain(PretrainOptions(run.data, run.folder, preset, without, change=change, use=use))
        return
    (data,) = run.data
    run_fewshot(
        FewshotOptions(
            data=data,
            run=run.folder,
            category=run.category or "scratch",
            protocol=run.setting,
            list=list_name,
            method=METHODS.get(run.method, "actorsnerf"),
            preset=preset,
            change=change,
            use=use,
            curve=True,
        )
    )
    run_evaluate(
        EvaluateOptions(
            checkpoint=run.folder,
            data=data,
            out=run.folder / EVALUATION,
            max_frames=max_frames,
            lpips=use.lpips,
            device=use.device,
        )
    )
