"""Runs the benchmarks of the data side one after the other: `make bench`.

Each is a program of its own (`python benchmarks/bench_storage.py --help`); results go to
`benchmarks/results/`. The first run draws the synthetic pictures, which takes long.
"""

import argparse
import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parent


def main() -> int:
    """Exit status 0 when all ran."""
    names = sorted(path.stem.removeprefix("bench_") for path in FOLDER.glob("bench_*.py"))
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(names)}; all")
    chosen = parser.parse_args().names or names
    failed = []
    for name in chosen:
        if name not in names:
            parser.error(f"no benchmark {name!r}; there are {', '.join(names)}")
        print(f"--- {name}", flush=True)
        command = [sys.executable, str(FOLDER / f"bench_{name}.py")]
        if subprocess.run(command, check=False).returncode:
            failed.append(name)
    if failed:
        print(f"error: failed: {', '.join(failed)}", file=sys.stderr)
    return len(failed)


if __name__ == "__main__":
    sys.exit(main())
