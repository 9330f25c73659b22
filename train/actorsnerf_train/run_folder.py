"""The folder of one training: what was asked, by which program, on which data.

`config.json` is written before the first step. The same command on the same folder goes on from
the latest checkpoint; another configuration or other data is refused, so a folder holds one run.
"""

import json
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.checkpoint import (
    FOLDER,
    LATEST,
    Checkpoint,
    DataFile,
    FewshotSetting,
    JsonObject,
    Origin,
    load_checkpoint,
    write_whole,
)
from actorsnerf_train.config import TrainConfig
from actorsnerf_train.machine import program_commit
from actorsnerf_train.records import from_json, to_json
from actorsnerf_train.result import Json

CONFIG = "config.json"
NO_RUN = "damaged, or no run of this program: choose another --run, or delete the folder."
PACKAGES = ("actorsnerf", "torch", "numpy", "h5py", "safetensors", "opencv-contrib-python-headless")


@dataclass(frozen=True)
class RunFolder:
    """Where a training writes, and what it is about."""

    path: Path
    config: TrainConfig
    data: tuple[DataFile, ...]
    setting: FewshotSetting | None
    origin: Origin

    def open(self, write: bool) -> Checkpoint | None:
        """The checkpoint to go on from, or None for a new run; writes `config.json` first.

        Args:
            write: whether this process writes.

        Raises:
            UserError: the folder holds another run.
        """
        known = _as_json(self.config, self.data, self.setting, self.origin)
        file = self.path / CONFIG
        if file.is_file():
            self._refuse_another(file, _found(file), known)
        checkpoint = load_checkpoint(self.path) if (self.path / FOLDER / LATEST).is_file() else None
        if checkpoint is not None:  # that `config.json` was lost makes it no other run
            self._refuse_another(checkpoint.path, _found_in(checkpoint), known)
        if write and not file.is_file():
            self.path.mkdir(parents=True, exist_ok=True)
            program = {"versions": package_versions(), "commit": program_commit()}
            write_whole(file, (json.dumps(known | {"program": program}, indent=1) + "\n").encode())
        return checkpoint

    def _refuse_another(self, place: Path, found: Json, known: Json) -> None:
        difference = first_difference(found, known, "")
        if difference:
            raise UserError(
                f"{place}: the folder holds another run ({difference}): choose another --run, "
                "or delete the folder."
            )


def _as_json(
    config: TrainConfig,
    data: tuple[DataFile, ...],
    setting: FewshotSetting | None,
    origin: Origin,
) -> dict[str, Json]:
    """What two trainings must share to be one run."""
    return {
        "configuration": to_json(config),
        # not the path: a folder of data may move
        "data": [[f.sequence, f.actor, f.digest] for f in data],
        "setting": to_json(setting),
        "category_digest": origin.category_digest,
    }


def _found(file: Path) -> Json:
    """What the folder holds; a setting that came after it was written has its default."""
    try:
        found: Json = json.loads(file.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise UserError(f"{file}: is not readable as JSON ({error}): {NO_RUN}") from None
    if not isinstance(found, dict):
        raise UserError(f"{file}: holds no JSON object: {NO_RUN}")
    config = from_json(TrainConfig, found.get("configuration"), f"{file}: configuration")
    return found | {"configuration": to_json(config)}


def _found_in(checkpoint: Checkpoint) -> Json:
    """The same, as a checkpoint tells it."""
    info = checkpoint.info
    config = from_json(TrainConfig, info.configuration, f"{checkpoint.path}: configuration")
    return _as_json(config, info.data, info.setting, info.origin)


def package_versions() -> JsonObject:
    """Versions of the packages that compute; None for one that is not installed."""
    return {name: _version(name) for name in PACKAGES}


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def first_difference(found: Json, wanted: Json, where: str) -> str | None:
    """Where two JSON values differ first, in words; keys that only `found` has do not count.

    >>> first_difference({"a": {"b": 1}, "c": 0}, {"a": {"b": 2}}, "")
    'a/b is 1 there, 2 here'
    """
    if isinstance(found, dict) and isinstance(wanted, dict):
        for key, value in wanted.items():
            difference = first_difference(found.get(key), value, f"{where}/{key}".strip("/"))
            if difference:
                return difference
        return None
    return None if found == wanted else f"{where} is {found!r} there, {wanted!r} here"
