"""`python -m actorsnerf_datasets check|describe`: prepared sequences from the command line."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from actorsnerf_datasets.check import check_sequence
from actorsnerf_datasets.contact_sheet import write_contact_sheet
from actorsnerf_datasets.describe import describe
from actorsnerf_datasets.errors import UserError
from actorsnerf_datasets.findings import Finding
from actorsnerf_datasets.reader import SequenceFile

_EXAMPLES = """examples:
  python -m actorsnerf_datasets describe prepared/CoreView_387.h5
  python -m actorsnerf_datasets describe prepared/CoreView_387.h5 --contact-sheet 387.png
  python -m actorsnerf_datasets check prepared/*.h5
  python -m actorsnerf_datasets check prepared/*.h5 --body-model SMPL_NEUTRAL.pkl
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code: 0 in order, 1 a check found errors, 2 the command could not be carried out."""
    options = _parser().parse_args(arguments)
    try:
        if options.command == "check":
            return _check(options.files, options.body_model)
        return _describe(options.files, options.contact_sheet)
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m actorsnerf_datasets",
        description="Look at prepared sequences (HDF5, layout 1): what is in them, is it right?",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    check = commands.add_parser(
        "check",
        help="is each file what the layout says, and can it be right?",
        description="Checks shapes, dtypes, finiteness, rotations, units, joints against pose, "
        "projected bodies against masks, protocols and digests. Exit code 1 if a file has errors.",
    )
    check.add_argument("files", type=Path, nargs="+", metavar="FILE", help="prepared .h5 files")
    check.add_argument(
        "--body-model",
        type=Path,
        metavar="FILE",
        help="SMPL-format .pkl or .npz the fits were made with: checks the vertices too",
    )
    describe_parser = commands.add_parser(
        "describe",
        help="one screen on what is in a file",
        description="Prints actor, source, cameras, frames, pictures, protocols and decisions.",
    )
    describe_parser.add_argument(
        "files", type=Path, nargs="+", metavar="FILE", help="prepared .h5 files"
    )
    describe_parser.add_argument(
        "--contact-sheet",
        type=Path,
        metavar="PNG",
        help="also draw frames x cameras with skeleton and mask outline (one FILE; needs the "
        "preprocess extra)",
    )
    return parser


def _check(files: list[Path], body_model: Path | None) -> int:
    failed = False
    for path in files:
        found = check_sequence(path, body_model)
        for finding in found:
            print(f"{path}: {finding.severity}: {finding.entry}: {finding.sentence}")
        print(f"{path}: {_verdict(path, found)}")
        failed |= any(finding.severity == "error" for finding in found)
    return int(failed)


def _verdict(path: Path, found: Sequence[Finding]) -> str:
    errors, warnings = (
        sum(finding.severity == severity for finding in found) for severity in ("error", "warning")
    )
    if errors or warnings:
        return f"{errors} errors, {warnings} warnings"
    with SequenceFile(path) as sequence:
        cameras, frames = sequence.row.shape
        pictures = len(sequence.offsets)
    return f"in order ({cameras} cameras, {frames} frames, {pictures} pictures)"


def _describe(files: list[Path], contact_sheet: Path | None) -> int:
    if contact_sheet is not None and len(files) > 1:
        raise UserError(f"--contact-sheet draws one file, but {len(files)} are given")
    for path in files:
        with SequenceFile(path) as sequence:
            print(describe(sequence))
            if contact_sheet is not None:
                write_contact_sheet(sequence, contact_sheet)
                print(f"drawn       {contact_sheet}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
