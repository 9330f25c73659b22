"""`result.json` written and read, and the same numbers as a Markdown table."""

import json
from pathlib import Path

from actorsnerf_datasets.errors import UserError
from actorsnerf_train.checkpoint import write_whole
from actorsnerf_train.records import RecordError, from_json, to_json
from actorsnerf_train.result import SCHEMA, SCHEMA_VERSION, Evaluation, Json

RESULT_NAME = "result.json"


def write_result(path: Path, evaluation: Evaluation) -> None:
    """Write one evaluation; the file has its name only once it is complete."""
    record: dict[str, Json] = {"schema": SCHEMA, "schema_version": SCHEMA_VERSION}
    fields = to_json(evaluation)
    assert isinstance(fields, dict)
    content = json.dumps(record | fields, indent=1, allow_nan=False)
    write_whole(path, (content + "\n").encode())


def read_result(path: Path) -> Evaluation:
    """The evaluation in a `result.json`, or in a folder that holds one.

    Raises:
        UserError: no such file, no result of this program, or one of a newer schema.
    """
    path = path / RESULT_NAME if path.is_dir() else path
    if not path.is_file():
        raise UserError(
            f"{path}: no such result; make one: python -m actorsnerf_train evaluate --help"
        )
    try:
        record: Json = json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: is not readable as JSON ({error}): damaged file?") from None
    if not isinstance(record, dict) or record.get("schema") != SCHEMA:
        raise UserError(f"{path}: is no result of this program (its schema is not {SCHEMA!r}).")
    version = record.get("schema_version")
    if not isinstance(version, int) or version > SCHEMA_VERSION:
        raise UserError(
            f"{path}: has schema version {version}, this program reads up to {SCHEMA_VERSION}: "
            "use the version of the program that wrote it, or evaluate again."
        )
    fields = {k: v for k, v in record.items() if k not in ("schema", "schema_version")}
    try:
        return from_json(Evaluation, fields, str(path))
    except RecordError as error:
        raise UserError(str(error)) from None


def markdown(evaluation: Evaluation) -> str:
    """The result for people: what was evaluated, the means, and each camera."""
    lines = [f"# {evaluation.actor}: {evaluation.method}, {_setting(evaluation)}", ""]
    lines += [
        f"Sequence `{evaluation.sequence}`, protocol `{evaluation.protocol}`, "
        f"{len(evaluation.frames)} frames x {len(evaluation.cameras)} cameras, "
        f"{_count(evaluation)} pictures; encoder {_encoder(evaluation)}; "
        f"seed {evaluation.seed}, step {evaluation.step}.",
        "",
    ]
    if evaluation.point is not None:
        lines += [f"Drawn at the operating point `{evaluation.point}`.", ""]
    if evaluation.limited:
        lines += ["**A quick look: only part of the protocol's frames and cameras.**", ""]
    if evaluation.missing:
        lines += [f"{len(evaluation.missing)} pictures of the protocol are missing.", ""]
    if evaluation.lpips_note:
        lines += [f"LPIPS not computed: {evaluation.lpips_note}", ""]
    lines += ["| camera | convention | PSNR | SSIM | LPIPS x1000 |", "|---|---|---|---|---|"]
    for mean in evaluation.means:
        numbers = _numbers(mean.psnr, mean.ssim, mean.lpips_x1000)
        lines.append(f"| **all** | {mean.convention} | {numbers} |")
    for row in evaluation.per_camera:
        numbers = _numbers(row.psnr, row.ssim, row.lpips_x1000)
        lines.append(f"| {row.camera} | {row.convention} | {numbers} |")
    return "\n".join(lines) + "\n"


def _setting(evaluation: Evaluation) -> str:
    if evaluation.setting is None:
        return "no few-shot setting"
    return f"{evaluation.setting} ({evaluation.list_name} list)"


def _count(evaluation: Evaluation) -> int:
    return len({(row.camera, row.frame) for row in evaluation.per_image})


def _encoder(evaluation: Evaluation) -> str:
    if evaluation.encoder is None:
        return "none"
    state = "pretrained" if evaluation.encoder_pretrained else "not pretrained"
    return f"{evaluation.encoder} ({state})"


def _numbers(psnr: float, ssim: float, lpips_x1000: float | None) -> str:
    distance = "-" if lpips_x1000 is None else f"{lpips_x1000:.2f}"
    return f"{psnr:.2f} | {ssim:.4f} | {distance}"
