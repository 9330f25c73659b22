"""Few-shot fitting of one unseen actor: what the command line asks for, made ready."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import torch

from actorsnerf_datasets.selection import FewshotChoice
from actorsnerf_datasets.torch_dataset import FewshotDataset
from actorsnerf_datasets.types import ListName
from actorsnerf_model.actorsnerf import ActorsNeRF
from actorsnerf_train.batches import view_to
from actorsnerf_train.checkpoint import (
    Checkpoint,
    CheckpointError,
    FewshotSetting,
    Origin,
    load_checkpoint,
)
from actorsnerf_train.config import (
    MethodName,
    PresetName,
    TrainConfig,
    alone,
    fewshot,
    of_person,
)
from actorsnerf_train.curve import Gauge, make_gauge
from actorsnerf_train.curve_file import CURVE
from actorsnerf_train.data_files import background_of, check_files, describe_file, refuse_leakage
from actorsnerf_train.distributed import local_device, team
from actorsnerf_train.loop import Training, train
from actorsnerf_train.methods import build_method
from actorsnerf_train.options import (
    Changes,
    Resources,
    changed,
    on_ground,
    perceptual_note,
    ready_perceptual,
    refuse_nonsense,
)
from actorsnerf_train.pretrain import begin_trunk
from actorsnerf_train.records import from_json
from actorsnerf_train.run_folder import RunFolder
from actorsnerf_train.saving import load_model

SCRATCH = Origin(None, False, None, None, ())
"""Of a method without an encoder that begins from random weights."""


@dataclass(frozen=True)
class FewshotOptions:
    """Fits a trained category to one new actor from a few pictures; minutes to hours, by preset.

    Its checkpoint renders without the data file. Next: evaluate, render.
    """

    data: Path
    """Prepared file of the new actor (held out for testing)."""
    run: Path
    """Folder for checkpoints, log, curves and sample pictures."""
    category: Literal["scratch"] | Path
    """Run folder or checkpoint of the category training; "scratch" begins from random weights and
    trains every part, to compare with."""
    protocol: str = "fewshot-10"
    """Which frames: fewshot-5, -10, -30, -100, -300 or short-video."""
    list: ListName | None = None
    """official: the published frames; auto: chosen by view coverage. Left out: official where the
    file has it."""
    trunk_file: Path | None = None
    """With --from scratch, where the preset's encoder begins from ImageNet weights: torchvision's
    resnet18-f37072fd.pth or vgg16-397923af.pth; vgg16 also comes with LPIPS."""
    study: str | None = None
    """Named protocol of the file, where it has several."""
    method: MethodName = "actorsnerf"
    """humannerf, neuralbody: the per-person baselines, with --from scratch only."""
    preset: PresetName | None = None
    """official, official-short, small, small-vgg or tiny; the category training's if left out."""
    change: Changes = field(default_factory=Changes)
    """Differences from the preset."""
    use: Resources = field(default_factory=Resources)
    """How to compute."""
    curve: bool = False
    """Measure a few evaluation pictures at stated steps (error against time, curve.jsonl); costs a
    minute or two that do not count as training. A run that has a curve goes on being measured."""


def run_fewshot(options: FewshotOptions) -> Path:
    """The last checkpoint of a fitting, newly begun or gone on with.

    Raises:
        UserError: category checkpoint, data, device or run folder are not as needed.
    """
    refuse_nonsense(options.change, options.use)
    category = load_category(options.category) if isinstance(options.category, Path) else None
    origin = SCRATCH if category is None else _origin(category)
    if options.use.check:
        check_files((options.data,))
    file = describe_file(options.data)
    refuse_leakage(file.actor, options.data, origin)
    device = local_device(options.use.device)
    perceptual = ready_perceptual(options.use.lpips)
    with team(device) as together:
        config = replace(
            _config(options, category), perceptual=perceptual.name, processes=together.processes
        )
        source = _source(options, config)
        vertices = source.supports[0].rest_vertices.shape[0]
        config = of_person(config, vertices, source.shots.frames)
        method = build_method(config, device)
        if category is not None:
            load_model(method, category)
        elif isinstance(method, ActorsNeRF):
            origin = begin_trunk(method, options.trunk_file)
        training = Training(
            folder=RunFolder(options.run, config, (file,), setting_of(source), origin),
            method=method,
            source=source,
            perceptual=perceptual.to(device),
            device=device,
            team=together,
            supports=tuple(view_to(view, device) for view in source.supports),
            workers=options.use.workers,
            gauge=_gauge(options, config, source, device),
        )
        for line in (*_announcement(training.folder), perceptual_note(perceptual)):
            training.say(line)
        return train(training)


def load_category(source: Path) -> Checkpoint:
    """The category checkpoint of a run folder, or a named one.

    Raises:
        CheckpointError: there is none, or it is of a few-shot fitting.
    """
    checkpoint = load_checkpoint(source)
    if checkpoint.info.stage != "pretrain":
        raise CheckpointError(
            f"{checkpoint.path}: is a few-shot checkpoint, expected one of a category training: "
            "name the folder of a pretrain run."
        )
    return checkpoint


def setting_of(source: FewshotDataset) -> FewshotSetting:
    """Which frames a fitting sees."""
    shots = source.shots
    return FewshotSetting(
        protocol=source.protocol.name,
        name=shots.name,
        list_name=shots.list_name,
        camera=source.protocol.training_camera,
        frames=shots.frames,
        supports=shots.support,
    )


def _config(options: FewshotOptions, category: Checkpoint | None) -> TrainConfig:
    if category is None:
        preset = options.preset or "small"
        config = alone(options.method, preset)
        return on_ground(changed(config, options.change), background_of((options.data,)))
    if options.method != category.info.method:
        raise CheckpointError(
            f"{category.path}: is of a category of {category.info.method}, but {options.method} is "
            f"asked, which learns one person alone: give --from scratch."
        )
    where = f"{category.path}: configuration"
    trained = from_json(TrainConfig, category.info.configuration, where)
    if options.preset not in (None, trained.preset):
        raise CheckpointError(
            f"{category.path}: was trained with the preset {trained.preset}, but {options.preset} "
            f"is asked: give --preset {trained.preset}, or pretrain with {options.preset}."
        )
    config = changed(fewshot(trained.preset), options.change)
    config = replace(config, method=trained.method, model=trained.model)
    # Pictures keep the ground that the encoder knows, whatever data set the actor is from.
    return on_ground(config, trained.render.background)


def _source(options: FewshotOptions, config: TrainConfig) -> FewshotDataset:
    return FewshotDataset(
        options.data,
        FewshotChoice(options.protocol, options.list, options.study, config.model.views),
        config.seed,
        config.patches.count,
        config.patches.side,
        config.schedule.steps,
    )


def _gauge(
    options: FewshotOptions, config: TrainConfig, source: FewshotDataset, device: torch.device
) -> Gauge | None:
    if not (options.curve or (options.run / CURVE).is_file()):
        return None
    protocol, lpips = source.protocol.name, options.use.lpips
    return make_gauge(options.data, protocol, config.render, lpips, device)


def _origin(category: Checkpoint) -> Origin:
    return replace(
        category.info.origin,
        category_digest=category.info.tensors_sha256,
        category_step=category.info.step,
        category_data=category.info.data,
        category_seconds=category.info.seconds,
    )


def _announcement(folder: RunFolder) -> tuple[str, ...]:
    setting, origin = folder.setting, folder.origin
    assert setting is not None
    own = f"ImageNet weights of {origin.trunk}" if origin.trunk_pretrained else "random weights"
    began = own if origin.category_digest is None else "the category checkpoint"
    frozen = "encoder and skinning frozen" if folder.config.freeze_category else "every part trains"
    return (
        f"few-shot fitting of actor {folder.data[0].actor} from {began}: {setting.name} "
        f"({setting.list_name} list), {len(setting.frames)} frames and {len(setting.supports)} "
        f"supports of camera {setting.camera}; {frozen}",
    )
