"""Does it learn? Category training, then few-shot fitting of unseen actors, against from scratch.

    python benchmarks/learning.py --root data/study --pretrain-steps 2000 --steps 500

Draws synthetic actors (8 for category training, 2 held out), prepares them, trains, evaluates in
unseen poses from unseen cameras and writes `benchmarks/results/learning.{md,json,png}`. What exists
below the root is not repeated, so an interrupted study goes on.
"""

import argparse
import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np

RESULTS = Path(__file__).resolve().parent / "results"
ACTORS = ("heldout00", "heldout01")
STRIP_ROWS = 6
TILE = (180, 192)
"""Width and height of a picture in the figure."""
GAP = 4
"""Pixels between the pictures of an evaluation's strip."""


@dataclass(frozen=True)
class Fitting:
    """One few-shot training."""

    actor: str
    setting: str
    scratch: bool

    @property
    def name(self) -> str:
        """Name of its run folder."""
        return f"{self.actor}-{self.setting}-{'scratch' if self.scratch else 'category'}"


FITTINGS = tuple(
    Fitting(actor, setting, scratch)
    for setting, scratch in (
        ("fewshot-5", True),
        ("fewshot-5", False),
        ("fewshot-30", False),
        ("fewshot-30", True),
    )
    for actor in ACTORS
)


def main() -> int:
    """Exit status 0 when the study is complete."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=Path, default=Path("data/study"))
    parser.add_argument("--pretrain-steps", type=int, default=2000)
    parser.add_argument("--steps", type=int, default=500, help="of each few-shot fitting")
    parser.add_argument("--category", type=Path, help="checkpoint to begin from, else the last")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--frames", type=int, default=8, help="evaluation frames")
    parser.add_argument("--only", nargs="*", default=[], help="names of fittings; all by default")
    parser.add_argument("--tables-only", action="store_true", help="train nothing")
    arguments = parser.parse_args()
    root: Path = arguments.root
    if not arguments.tables_only:
        category = arguments.category or _category(root, arguments.pretrain_steps, arguments.seed)
        for fitting in FITTINGS:
            if not arguments.only or fitting.name in arguments.only:
                _fit(root, fitting, category, arguments)
    _report(root)
    return 0


def _run(module: str, *words: str | Path) -> None:
    command = ["-m", module, *(str(word) for word in words)]
    print("\n$ python", " ".join(command), flush=True)
    subprocess.run([sys.executable, *command], check=True)


def _category(root: Path, steps: int, seed: int) -> Path:
    raw, prepared, run = root / "raw", root / "prepared", root / "pretrain"
    if not (raw / "synthetic.json").is_file():
        _run("actorsnerf_preprocess", "synthetic", "--out", raw, "--preset", "study")
    _run("actorsnerf_preprocess", "prepare", "--source", raw, "--out", prepared)
    words = ("--preset", "small", "--steps", str(steps), "--seed", str(seed))
    _run("actorsnerf_train", "pretrain", "--data", prepared, "--run", run, *words)
    return run


def _fit(root: Path, fitting: Fitting, category: Path, arguments: argparse.Namespace) -> None:
    run = root / fitting.name
    if (run / "evaluation" / "result.json").is_file():
        return
    data = root / "prepared" / f"CoreView_{fitting.actor}.h5"
    origin: tuple[str | Path, ...] = ("--from", category)
    if fitting.scratch:
        origin = ("--from", "scratch", "--preset", "small")
    words = ("--protocol", fitting.setting, "--steps", str(arguments.steps))
    seed = ("--seed", str(arguments.seed))
    _run("actorsnerf_train", "fewshot", "--data", data, "--run", run, *origin, *words, *seed)
    look = ("--max-frames", str(arguments.frames), "--strip", str(STRIP_ROWS))
    where = ("--checkpoint", run, "--data", data, "--out", run / "evaluation")
    _run("actorsnerf_train", "evaluate", *where, *look)


def _report(root: Path) -> None:
    done = [fitting for fitting in FITTINGS if _result_path(root, fitting).is_file()]
    results = {
        fitting.name: json.loads(_result_path(root, fitting).read_text()) for fitting in done
    }
    lines = [
        "| actor | setting | begins from | steps | PSNR | SSIM | LPIPS x1000 | training, s |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    summary = []
    for fitting in done:
        result = results[fitting.name]
        means = {row["convention"]: row for row in result["means"]}
        row = means["box"]
        origin = "random weights" if fitting.scratch else "category"
        lines.append(
            f"| {fitting.actor} | {fitting.setting} | {origin} | {result['step']} | "
            f"{row['psnr']:.2f} | {row['ssim']:.4f} | {row['lpips_x1000']:.1f} | "
            f"{result['training_seconds']:.0f} |"
        )
        keep = (
            "actor",
            "setting",
            "step",
            "seed",
            "training_seconds",
            "means",
            "commit",
            "machine",
        )
        summary.append(
            {key: result[key] for key in keep} | {"from": origin, "data": result["data_sha256"]}
        )
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "learning_table.md").write_text("\n".join(lines) + "\n")
    (RESULTS / "learning.json").write_text(json.dumps(summary, indent=1) + "\n")
    print("\n".join(lines))
    _figure(root, done)
    _curves(root, done)


def _result_path(root: Path, fitting: Fitting) -> Path:
    return root / fitting.name / "evaluation" / "result.json"


def _figure(root: Path, done: list[Fitting]) -> None:
    """Per actor: truth beside every fitting's picture of the same unseen poses and views."""
    for actor in ACTORS:
        mine = [fitting for fitting in done if fitting.actor == actor]
        if not mine:
            continue
        strips = [_rows(root / fitting.name / "evaluation" / "strip.png") for fitting in mine]
        titles = [f"{f.setting[8:]} shots, {'scratch' if f.scratch else 'category'}" for f in mine]
        lines = [[_title(text) for text in ("truth", *titles)]]
        for number in range(0, STRIP_ROWS, 2):
            shown = [strips[0][number][0], *(strip[number][1] for strip in strips)]
            lines.append([cv2.resize(picture, TILE) for picture in shown])
        picture = np.concatenate([np.concatenate(line, 1) for line in lines])
        cv2.imwrite(str(RESULTS / f"learning_{actor}.png"), picture)


def _title(text: str) -> np.ndarray:
    tile = np.zeros((24, TILE[0], 3), np.uint8)
    cv2.putText(
        tile, text, (4, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA
    )
    return tile


def _rows(path: Path) -> list[list[np.ndarray]]:
    """The pictures of a strip: rows of truth, prediction, error."""
    sheet = cv2.imread(str(path))
    width = (sheet.shape[1] - 2 * GAP) // 3
    height = (sheet.shape[0] + GAP) // STRIP_ROWS - GAP
    count = STRIP_ROWS
    return [
        [sheet[i * (height + GAP) :, j * (width + GAP) :][:height, :width] for j in range(3)]
        for i in range(count)
    ]


def _curves(root: Path, done: list[Fitting]) -> None:
    figure, axes = plt.subplots(1, 2, figsize=(9, 3), dpi=110)
    runs = {"category training": root / "pretrain"}
    runs |= {f.name: root / f.name for f in done if f.actor == ACTORS[0]}
    for (name, run), axis in zip(runs.items(), [axes[0], *[axes[1]] * len(runs)], strict=False):
        entries = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
        entries = [entry for entry in entries if "lpips" in entry]
        axis.plot([e["step"] for e in entries], [e["lpips"] for e in entries], label=name, lw=1)
    for axis in axes:
        axis.set_xlabel("step")
        axis.set_ylabel("LPIPS of training patches")
        axis.legend(fontsize=6)
    figure.tight_layout()
    figure.savefig(RESULTS / "learning_curves.png")


if __name__ == "__main__":
    sys.exit(main())
