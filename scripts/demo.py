"""From raw trees to an animatable person in one go: the same commands that real data needs.

Without `--source`, synthetic actors are drawn first. Every step is a command that is printed
before it runs, so it can be copied; a step whose result exists is not repeated.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path


def main() -> int:
    """Exit status 0 when every step went through."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("data/demo"))
    parser.add_argument("--source", type=Path, help="a real download instead of synthetic actors")
    parser.add_argument("--body-model", type=Path, help="SMPL file, for a real download")
    parser.add_argument("--preset", default="tiny")
    parser.add_argument("--protocol", default="fewshot-5")
    arguments = parser.parse_args()
    started = time.monotonic()
    try:
        prepared = prepare(arguments.out, arguments.source, arguments.body_model)
        actor = train(arguments.out, prepared, arguments.preset, arguments.protocol)
    except subprocess.CalledProcessError as error:
        print(f"demo: stopped at the command above (exit {error.returncode}).", file=sys.stderr)
        return 1
    show(arguments.out, actor, time.monotonic() - started)
    return 0


def step(module: str, *words: str | Path) -> None:
    """Run one command of the project and show it first."""
    command = ["-m", module, *(str(word) for word in words)]
    print("\n$ python", " ".join(command), flush=True)
    subprocess.run([sys.executable, *command], check=True)


def prepare(out: Path, source: Path | None, body_model: Path | None) -> Path:
    """The folder of prepared files."""
    prepared = out / "prepared"
    if source is None:
        source = out / "raw"
        if not (source / "held_out.txt").is_file():
            step("actorsnerf_preprocess", "synthetic", "--out", source, "--preset", "tiny")
    extra = ("--body-model", body_model) if body_model else ()
    step("actorsnerf_preprocess", "prepare", "--source", source, "--out", prepared, *extra)
    return prepared


def held_out_file(prepared: Path) -> Path:
    """The first prepared file of an actor that no pre-training may see."""
    from actorsnerf_datasets import SequenceFile

    for path in sorted(prepared.glob("*.h5")):
        with SequenceFile(path) as sequence:
            if any(protocol.role == "held_out" for protocol in sequence.header.protocols):
                return path
    sys.exit(f"demo: {prepared} has no held-out actor; name one with `prepare --held-out NAME`.")


def train(out: Path, prepared: Path, preset: str, protocol: str) -> Path:
    """The run folder of the fitted new actor, evaluated and rendered."""
    category, actor = out / "pretrain", out / protocol
    unseen = held_out_file(prepared)
    words: tuple[str | Path, ...] = ("--data", prepared, "--run", category, "--preset", preset)
    step("actorsnerf_train", "pretrain", *words)
    words = ("--data", unseen, "--from", category, "--run", actor, "--preset", preset)
    step("actorsnerf_train", "fewshot", *words, "--protocol", protocol)
    shown: tuple[str | Path, ...] = ("--checkpoint", actor)
    look = ("--max-frames", "6", "--max-cameras", "2")
    evaluation = ("--data", unseen, "--out", actor / "evaluation", *look)
    step("actorsnerf_train", "evaluate", *shown, *evaluation)
    turntable = ("--out", actor / "turntable", "--pictures", "24", "--size", "256")
    step("actorsnerf_train", "render", *shown, *turntable)
    return actor


def show(out: Path, actor: Path, seconds: float) -> None:
    """Say what came out and where to look."""
    results = sorted(actor.rglob("result.json"))
    print(f"\nDone in {seconds / 60:.1f} minutes. Look at:")
    for picture in sorted([*actor.rglob("*.png"), *actor.rglob("*.mp4")])[:12]:
        print(f"  {picture}")
    for path in results:
        for row in json.loads(path.read_text())["means"]:
            print(f"{path}: {json.dumps(row)}")
    print(f"Everything is in {out}; a second `make demo` only repeats what is missing.")


if __name__ == "__main__":
    sys.exit(main())
