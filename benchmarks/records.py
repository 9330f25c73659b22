"""What a benchmark leaves: a table on the screen, and the same as Markdown and JSON in results/."""

import json
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path

RESULTS = Path(__file__).resolve().parent / "results"
BUSY_LOAD = 0.5
"""Processes that wanted to run, per core, before a benchmark began: more is a shared machine."""
PACKAGES = ("numpy", "h5py", "opencv-contrib-python-headless", "torch")
_LOAD_AT_START = os.getloadavg()[0]


@dataclass(frozen=True)
class Table:
    """Figures of one kind."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str | float | int, ...], ...]
    remark: str = ""


@dataclass(frozen=True)
class Seconds:
    """What one call takes: medians over repetitions."""

    wall: float
    cpu: float
    """Of this process; of single-threaded work it is what a machine of one's own would take."""


def timed(function: Callable[[], object], repeats: int) -> Seconds:
    """The time of one call, after one that does not count."""
    function()
    walls, cpus = [], []
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), time.process_time()
        function()
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    return Seconds(statistics.median(walls), statistics.median(cpus))


@contextmanager
def stopwatch(laps: list[float]) -> Iterator[None]:
    """Appends the wall seconds of its context."""
    started = time.perf_counter()
    yield
    laps.append(time.perf_counter() - started)


def record(name: str, intro: str, seed: int, tables: Sequence[Table]) -> None:
    """Prints the tables and writes `results/<name>.md` and `.json`."""
    circumstances = _circumstances(seed)
    text = f"# {intro}\n\n{_sentence(circumstances)}\n\n" + "\n".join(map(_markdown, tables))
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / f"{name}.md").write_text(text)
    content = {"circumstances": circumstances, "tables": [asdict(table) for table in tables]}
    (RESULTS / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n")
    print(text, flush=True)


def _circumstances(seed: int) -> dict[str, str | int | float | bool | dict[str, str]]:
    cores = os.cpu_count() or 1
    return {
        "command": " ".join(["python", Path(sys.argv[0]).name, *sys.argv[1:]]),
        "commit": _commit(),
        "seed": seed,
        "processor": _processor(),
        "cores": cores,
        "memory_gib": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "packages": {name: metadata.version(name) for name in PACKAGES},
        "load_at_start": round(_LOAD_AT_START, 2),
        "shared": BUSY_LOAD * cores < _LOAD_AT_START,
    }


def _sentence(circumstances: dict[str, object]) -> str:
    packages = circumstances["packages"]
    assert isinstance(packages, dict)
    versions = ", ".join(f"{name} {version}" for name, version in packages.items())
    load = circumstances["load_at_start"]
    shared = (
        f"The machine was **shared**: its load was {load} when this began, so wall times are too "
        "long and ratios of them are rough; CPU times are not affected much."
        if circumstances["shared"]
        else f"The machine was otherwise idle (load {load} when this began)."
    )
    return (
        f"{circumstances['processor']}, {circumstances['cores']} cores, "
        f"{circumstances['memory_gib']} GiB; Python {circumstances['python']}, {versions}; commit "
        f"{circumstances['commit']}, seed {circumstances['seed']}. {shared} Medians. Made by "
        f"`{circumstances['command']}`."
    )


def _markdown(table: Table) -> str:
    lines = [f"## {table.title}", "", _row(table.columns), _row(["---"] * len(table.columns))]
    lines += [_row([_shown(value) for value in row]) for row in table.rows]
    if table.remark:
        lines += ["", table.remark]
    return "\n".join(lines) + "\n"


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _shown(value: str | float | int) -> str:
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return f"{value:,}" if isinstance(value, int) else value


def _commit() -> str:
    def git(*words: str) -> str:
        done = subprocess.run(
            ["git", "-C", str(RESULTS.parent), *words], capture_output=True, text=True, check=False
        )
        return done.stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", "..")
    return git("rev-parse", "--short", "HEAD") + (" with changes" if changed else "")


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if "model name" in line), "")
