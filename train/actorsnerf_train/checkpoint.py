"""A training's state on disk: safetensors for numbers, JSON for everything else, written whole.

`checkpoints/step_000200.safetensors` holds `model/...`, `optimiser/...` and, after few-shot
fitting, `actor/...` (all that rendering needs without the data file); the JSON beside it says what
they are and carries the digest of the tensors. The JSON is written last, and `latest` names it
after that, so a checkpoint that can be seen is complete.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import safetensors.torch
import torch
from torch import Tensor, nn

from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.types import ListName
from actorsnerf_train.records import RecordError, from_json, to_json_object
from actorsnerf_train.result import Json

FORMAT = "actorsnerf-checkpoint"
FORMAT_VERSION = 1
FOLDER = "checkpoints"
LATEST = "latest"
STEM = "step_{:06d}"
"""Name of the two files of a step's checkpoint."""
Stage = Literal["pretrain", "fewshot"]
JsonObject = Mapping[str, Json]


class CheckpointError(UserError):
    """A checkpoint is missing, damaged, or of another configuration."""


@dataclass(frozen=True)
class DataFile:
    """A prepared file that a training read."""

    path: str
    sequence: str
    actor: str
    digest: str


@dataclass(frozen=True)
class FewshotSetting:
    """Which frames of the actor were seen."""

    protocol: str
    name: str
    list_name: ListName
    camera: str
    frames: tuple[int, ...]
    supports: tuple[int, ...]


@dataclass(frozen=True)
class Origin:
    """Where the first weights came from."""

    trunk: str | None
    """Name of the encoder's trunk; None where the method has no encoder."""
    trunk_pretrained: bool
    """Whether category training began with published weights of it."""
    category_digest: str | None
    """SHA-256 of the category checkpoint's tensors; None: category training, or from scratch."""
    category_step: int | None
    category_data: tuple[DataFile, ...]
    """What the category training had seen."""
    category_seconds: float | None = None
    """That it had trained."""


@dataclass(frozen=True)
class CheckpointInfo:
    """What a checkpoint is; the JSON file."""

    format: str
    format_version: int
    stage: Stage
    method: str
    step: int
    seconds: float
    """Training time up to here, all resumed parts together."""
    configuration: JsonObject
    """The training's `TrainConfig`."""
    origin: Origin
    data: tuple[DataFile, ...]
    setting: FewshotSetting | None
    generator: str
    """State of torch's default generator, hex. Samples and jitter depend on (seed, step) alone."""
    loss_scale: JsonObject
    """State of float16's loss scaling; empty otherwise."""
    versions: JsonObject
    """Of the packages that computed."""
    commit: str | None
    tensors_sha256: str


@dataclass(frozen=True)
class Checkpoint:
    """A loaded checkpoint."""

    path: Path
    """Of the JSON file."""
    info: CheckpointInfo
    tensors: dict[str, Tensor]

    def part(self, prefix: Literal["model", "optimiser", "actor"]) -> dict[str, Tensor]:
        """The tensors of one part, without the prefix."""
        start = len(prefix) + 1
        return {k[start:]: v for k, v in self.tensors.items() if k.startswith(f"{prefix}/")}


def write_whole(path: Path, content: bytes) -> None:
    """Put a file in place at once: a reader sees the old content or the new, never a half.

    Raises:
        OSError: the disk refuses; names the file, of which nothing new is left.
    """
    part = path.with_name(path.name + ".part")
    try:
        with part.open("wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(path)
    except OSError as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)  # a full disk needs the room
        raise OSError(error.errno, error.strerror, str(path)) from error


def save_checkpoint(run: Path, info: CheckpointInfo, tensors: dict[str, Tensor]) -> Path:
    """The JSON file of a newly written checkpoint; `latest` names it.

    Args:
        run: the run's folder.
        info: its `tensors_sha256` is filled in here.
        tensors: names start with "model/", "optimiser/" or "actor/".
    """
    folder = run / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    stem = STEM.format(info.step)
    plain = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    content = safetensors.torch.save(plain)
    write_whole(folder / f"{stem}.safetensors", content)
    record = to_json_object(info)
    record["tensors_sha256"] = hashlib.sha256(content).hexdigest()
    path = folder / f"{stem}.json"
    write_whole(path, (json.dumps(record, indent=1) + "\n").encode())
    write_whole(folder / LATEST, (stem + "\n").encode())
    return path


def load_checkpoint(source: Path) -> Checkpoint:
    """The checkpoint of a run folder (its latest) or of a named checkpoint file.

    Raises:
        CheckpointError: there is none, or it is damaged.
    """
    path = checkpoint_path(source)
    info = load_info(path)
    numbers = path.with_suffix(".safetensors")
    if not numbers.is_file():
        raise CheckpointError(f"{numbers}: no such file, but {path.name} is there: copy both.")
    content = numbers.read_bytes()
    if hashlib.sha256(content).hexdigest() != info.tensors_sha256:
        raise CheckpointError(
            f"{numbers}: its SHA-256 is not the one that {path.name} names: a damaged or mixed-up "
            "copy; take an earlier checkpoint of the run, or copy it again."
        )
    return Checkpoint(path, info, safetensors.torch.load(content))


def load_info(source: Path) -> CheckpointInfo:
    """What a checkpoint is, without its numbers.

    Raises:
        CheckpointError: there is none, or it is damaged.
    """
    path = checkpoint_path(source)
    try:
        record: Json = json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise CheckpointError(f"{path}: is not readable as JSON ({error}): damaged file?") from None
    _check_format(path, record)
    try:
        return from_json(CheckpointInfo, record, str(path))
    except RecordError as error:
        raise CheckpointError(str(error)) from None


def checkpoint_path(source: Path) -> Path:
    """The JSON file that a run folder or a checkpoint's name leads to.

    Raises:
        CheckpointError: there is none.
    """
    if source.is_dir():
        latest = source / FOLDER / LATEST
        if not latest.is_file():
            raise CheckpointError(
                f"{source}: holds no checkpoint ({FOLDER}/{LATEST} is missing): not a run folder, "
                "or its training was stopped before the first checkpoint."
            )
        path = source / FOLDER / f"{latest.read_text(encoding='utf-8').strip()}.json"
        if not path.is_file():
            raise CheckpointError(
                f"{latest}: names {path.name}, which is not there: an incomplete copy? Copy the "
                "run again, or name another of its checkpoints."
            )
        return path
    path = source.with_suffix(".json")
    if source.is_file() and not path.is_file():
        raise CheckpointError(
            f"{source}: is no checkpoint ({path.name} is not beside it): copy both files of one; a "
            "baked actor is taken by render and evaluate only."
        )
    if not path.is_file():
        raise CheckpointError(
            f"{source}: no such run folder or checkpoint; pretrain first "
            "(python -m actorsnerf_train pretrain), or correct the path."
        )
    return path


def prune_checkpoints(run: Path, keep: int, keep_every: int) -> None:
    """Delete old checkpoints, but the newest `keep` and every `keep_every`-th step (0 = none)."""
    paths = sorted((run / FOLDER).glob("step_*.json"), key=_step_of)  # not by name: a million has 7
    for path in paths[: max(len(paths) - keep, 0)]:
        if keep_every == 0 or _step_of(path) % keep_every:
            path.unlink()  # the JSON first: without it there is no checkpoint
            path.with_suffix(".safetensors").unlink(missing_ok=True)


def _step_of(path: Path) -> int:
    return int(path.stem.removeprefix("step_"))


def optimiser_tensors(
    optimiser: torch.optim.Optimizer, parameters: dict[str, nn.Parameter]
) -> dict[str, Tensor]:
    """The optimiser's memory by parameter name: `<name>/<entry>`."""
    return {
        f"{name}/{entry}": tensor
        for name, parameter in parameters.items()
        for entry, tensor in optimiser.state.get(parameter, {}).items()
    }


def restore_optimiser(
    optimiser: torch.optim.Optimizer,
    parameters: dict[str, nn.Parameter],
    tensors: dict[str, Tensor],
) -> None:
    """Give the optimiser its memory back; parameters without one start afresh, as they did."""
    for key, tensor in tensors.items():
        name, _, entry = key.rpartition("/")
        parameter = parameters[name]
        memory = tensor if entry == "step" else tensor.to(parameter.device)
        optimiser.state[parameter][entry] = memory.clone()


def _check_format(path: Path, record: Json) -> None:
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        raise CheckpointError(f"{path}: is no checkpoint of this program (format {FORMAT}).")
    version = record.get("format_version")
    if not isinstance(version, int) or version > FORMAT_VERSION:
        raise CheckpointError(
            f"{path}: has checkpoint format {version}, this program reads up to {FORMAT_VERSION}: "
            "use the version of the program that wrote it, or a newer one."
        )
