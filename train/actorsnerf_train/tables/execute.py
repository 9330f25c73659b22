"""A planned run made, or gone on with: trained, and evaluated if it is of one actor."""

from actorsnerf_train.config import pretraining
from actorsnerf_train.evaluate import EvaluateOptions, run_evaluate
from actorsnerf_train.fewshot import FewshotOptions, run_fewshot
from actorsnerf_train.options import Changes
from actorsnerf_train.pretrain import PretrainOptions, run_pretrain
from actorsnerf_train.tables.options import ABLATED, TablesOptions, method_of
from actorsnerf_train.tables.plan import EVALUATION, Run


def execute(run: Run, options: TablesOptions) -> None:
    """Train the run to its end and evaluate it; what is done is not repeated.

    Args:
        run: of a plan.
        options: that the plan follows.
    """
    preset, use = options.preset, options.use
    change = Changes(steps=run.steps, seed=run.seed)
    if run.setting is None:
        without = (ABLATED[run.method],) if run.method in ABLATED else ()
        asks = pretraining(preset).actorsnerf.encoder.weights == "imagenet"
        run_pretrain(
            PretrainOptions(
                run.data,
                run.folder,
                preset,
                without,
                trunk_file=options.trunk_file if asks else None,
                change=change,
                use=use,
            )
        )
        return
    (data,) = run.data
    run_fewshot(
        FewshotOptions(
            data=data,
            run=run.folder,
            category=run.category or "scratch",
            protocol=run.setting,
            list=options.list,
            trunk_file=options.trunk_file,
            method=method_of(run.method),
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
            max_frames=options.max_frames,
            lpips=use.lpips,
            device=use.device,
        )
    )
