"""Is everything in the wheel that the tree has, and can the reader live on numpy and h5py alone?"""

import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PARTS = ("datasets", "preprocess", "model", "train")
READER = """
import sys
import actorsnerf_datasets
heavy = {"torch", "cv2", "scipy", "tyro", "jaxtyping"} & set(sys.modules)
assert not heavy, f"importing the reader pulled in {sorted(heavy)}"
"""


def main(folder: str) -> int:
    """Exit status 0 when the newest wheel in the folder is complete."""
    wheel = max(Path(folder).glob("actorsnerf-*.whl"), key=lambda path: path.stat().st_mtime)
    with zipfile.ZipFile(wheel) as archive:
        packed = set(archive.namelist())
    listed = subprocess.run(
        ["git", "ls-files", *PARTS], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split()
    wanted = {
        str(Path(name).relative_to(part))
        for name in listed
        for part in PARTS
        if name.startswith(f"{part}/actorsnerf_{part}/")
    }
    missing = sorted(wanted - packed)
    if missing:
        print(f"{wheel.name} lacks: {', '.join(missing)}", file=sys.stderr)
        return 1
    subprocess.run([sys.executable, "-c", READER], check=True)
    print(f"{wheel.name}: {len(wanted)} files, the reader needs only numpy and h5py")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
