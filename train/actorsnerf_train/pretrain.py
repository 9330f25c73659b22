"""Category-level training from prepared files: what the command line asks for, made ready."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.torch_dataset import PretrainingDataset
from actorsnerf_model.actorsnerf import ActorsNeRF, ActorsNeRFConfig
from actorsnerf_model.pretrained import load_trunk
from actorsnerf_train.checkpoint import Origin
from actorsnerf_train.config import PresetName, TrainConfig, pretraining
from actorsnerf_train.data_files import background_of, check_files, describe_file, training_files
from actorsnerf_train.distributed import local_device, team
from actorsnerf_train.loop import Training, train
from actorsnerf_train.methods import actorsnerf, build_method
from actorsnerf_train.options import (
    Changes,
    Resources,
    changed,
    on_ground,
    perceptual_note,
    ready_perceptual,
    refuse_nonsense,
)
from actorsnerf_train.run_folder import RunFolder

Part = Literal["deformation", "pixel_features", "body_features"]


@dataclass(frozen=True)
class PretrainOptions:
    """Learns what all actors share from prepared files; minutes to days, by preset.

    An interrupted training goes on with the same command. Next: fewshot.
    """

    data: tuple[Path, ...]
    """Prepared files, or folders of them (actors held out for testing are left out)."""
    run: Path
    """Folder for checkpoints, log, curves and sample pictures."""
    preset: PresetName = "small"
    """official: the paper's; official-short: its sizes, for runs of some hundred steps; small: two
    CPU cores, within the hour; tiny: seconds."""
    without: tuple[Part, ...] = ()
    """Parts to leave out, as in the paper's ablations."""
    trunk: Literal["resnet18", "vgg16"] | None = None
    """Image encoder: resnet18 (paper's) or vgg16; the preset's if left out."""
    trunk_weights: Literal["imagenet", "random"] | None = None
    """What the encoder's trunk begins from; the preset's if left out."""
    trunk_file: Path | None = None
    """torchvision's resnet18-f37072fd.pth or vgg16-397923af.pth; vgg16 also comes with LPIPS. Give
    --trunk-weights imagenet with it where the preset begins from random ones."""
    change: Changes = field(default_factory=Changes)
    """Differences from the preset."""
    use: Resources = field(default_factory=Resources)
    """How to compute."""


def run_pretrain(options: PretrainOptions) -> Path:
    """The last checkpoint of a category training, newly begun or gone on with.

    Raises:
        UserError: data, weights, device or run folder are not as needed.
    """
    refuse_nonsense(options.change, options.use)
    paths, left_out = training_files(options.data)
    if options.use.check:
        check_files(paths)
    device = local_device(options.use.device)
    perceptual = ready_perceptual(options.use.lpips)
    with team(device) as together:
        config = replace(
            _config(options, paths), perceptual=perceptual.name, processes=together.processes
        )
        method = build_method(config, device)
        folder = RunFolder(
            path=options.run,
            config=config,
            data=tuple(describe_file(path) for path in paths),
            setting=None,
            origin=begin_trunk(actorsnerf(method), options.trunk_file),
        )
        training = Training(
            folder=folder,
            method=method,
            source=_source(paths, config),
            perceptual=perceptual.to(device),
            device=device,
            team=together,
            workers=options.use.workers,
        )
        for line in (*left_out, *_announcement(folder), perceptual_note(perceptual)):
            training.say(line)
        return train(training)


def begin_trunk(method: ActorsNeRF, file: Path | None) -> Origin:
    """Where the first weights came from, once the encoder's trunk has those that it begins with.

    Args:
        method: of random weights.
        file: of ImageNet weights, where the configuration asks for them.

    Raises:
        WeightsError: the file is missing, of another network, or holds untrained weights.
    """
    trunk = None if method.encoder is None else load_trunk(method.encoder, file)
    return Origin(
        trunk=trunk.trunk if trunk else None,
        trunk_pretrained=trunk is not None and trunk.weights != "random",
        category_digest=None,
        category_step=None,
        category_data=(),
    )


def _config(options: PretrainOptions, paths: tuple[Path, ...]) -> TrainConfig:
    preset = changed(pretraining(options.preset), options.change)
    config = replace(preset, model=_model(preset.actorsnerf, options))
    encoder = config.actorsnerf.encoder
    if options.trunk_file is not None and encoder.weights == "random":
        raise UserError(
            f"--trunk-file {options.trunk_file}: the encoder would begin from random weights and "
            "leave the file out: add --trunk-weights imagenet, or leave out --trunk-file."
        )
    return on_ground(config, background_of(paths))


def _model(preset: ActorsNeRFConfig, options: PretrainOptions) -> ActorsNeRFConfig:
    encoder = replace(
        preset.encoder,
        trunk=options.trunk or preset.encoder.trunk,
        weights=options.trunk_weights or preset.encoder.weights,
    )
    return replace(
        preset,
        encoder=encoder,
        deformation=preset.deformation and "deformation" not in options.without,
        pixel_features=preset.pixel_features and "pixel_features" not in options.without,
        body_features=preset.body_features and "body_features" not in options.without,
    )


def _source(paths: tuple[Path, ...], config: TrainConfig) -> PretrainingDataset:
    return PretrainingDataset(
        paths,
        config.seed,
        config.model.views,
        config.patches.count,
        config.patches.side,
        config.schedule.steps,
    )


def _announcement(folder: RunFolder) -> tuple[str, ...]:
    actors = sorted({file.actor for file in folder.data})
    trunk = folder.origin.trunk
    started = "published weights" if folder.origin.trunk_pretrained else "random weights"
    return (
        f"category training of {folder.config.method} ({folder.config.preset}) on "
        f"{len(folder.data)} files, {len(actors)} actors: {', '.join(actors)}",
        f"encoder: {trunk} from {started}" if trunk else "encoder: none",
    )
