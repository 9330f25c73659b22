"""Invented evaluations, written where the tables look for them."""

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import pytest

from actorsnerf_train.result import Evaluation, MeanRow
from actorsnerf_train.result_file import write_result


class WriteResult(Protocol):
    def __call__(self, scores: tuple[float, float, float | None], **changes: object) -> Path: ...


@pytest.fixture
def write(tmp_path: Path, evaluation: Evaluation) -> WriteResult:
    """Writes one evaluation: (PSNR, SSIM, LPIPS x1000) under `paper` and, 2 dB lower, `box`."""
    written: list[Path] = []

    def write_one(scores: tuple[float, float, float | None], **changes: object) -> Path:
        psnr, ssim, distance = scores
        result = replace(evaluation, **changes)  # type: ignore[arg-type]  # the caller's fields
        result = replace(
            result,
            shots=None
            if result.setting is None
            else int(result.setting.split("-")[-1])
            if result.setting.startswith("fewshot")
            else 10,
            data_sha256=result.data_sha256 or hashlib.sha256(result.actor.encode()).hexdigest(),
            means=(
                MeanRow("paper", psnr, ssim, distance),
                MeanRow("box", psnr - 2, ssim, distance),
            ),
        )
        folder = tmp_path / "results" / f"{len(written):02d}"
        folder.mkdir(parents=True)
        write_result(folder / "result.json", result)
        written.append(folder)
        return folder / "result.json"

    return write_one
