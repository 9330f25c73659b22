"""Injected faults and what the user reads, as a table: `benchmarks/results/faults.md`.

Runs the tests `tests/**/test_faults*.py` and tabulates what they record.
"""

import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parent.parent
TABLE = ROOT / "benchmarks" / "results" / "faults.md"
HEAD = """# Faults

{count} injected faults, each by a test in `tests/**/test_faults*.py`: {summary}. Hostile pickles
make a folder if they are executed; none was made. Refused commands exit with 2 and leave no file
of a final name; counted ones prepare the rest and say what is missing, on the screen and in the
report of the run. This table is made by `scripts/fault_table.py` from what the tests saw.

| fault | what the user reads | outcome |
|---|---|---|
"""


def main() -> int:
    """Exit code of pytest; the table is written if all tests pass."""
    tests = sorted(str(path.relative_to(ROOT)) for path in ROOT.glob("tests/*/test_faults*.py"))
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        command = [sys.executable, "-m", "pytest", "-q", f"--junitxml={report}"]
        command += ["-o", "junit_family=xunit1", *tests]
        code = subprocess.run(command, cwd=ROOT, check=False).returncode
        if code:
            return code
        rows = recorded(report)
    TABLE.parent.mkdir(parents=True, exist_ok=True)
    TABLE.write_text(table(rows))
    print(f"{len(rows)} faults in {TABLE.relative_to(ROOT)}")
    return 0


def recorded(report: Path) -> list[dict[str, str]]:
    """The properties `fault`, `reads` and `outcome` of each test that has them."""
    rows = []
    for case in ElementTree.parse(report).getroot().iter("testcase"):
        found = {
            one.attrib["name"]: one.attrib["value"] for one in case.findall("properties/property")
        }
        if "fault" in found:
            rows.append(found)
    return rows


def table(rows: list[dict[str, str]]) -> str:
    """The Markdown text."""
    outcomes = Counter(row["outcome"] for row in rows)
    summary = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.most_common())
    lines = [
        f"| {cell(row['fault'])} | {cell(row['reads'])} | {cell(row['outcome'])} |" for row in rows
    ]
    return HEAD.format(count=len(rows), summary=summary) + "\n".join(lines) + "\n"


def cell(text: str) -> str:
    """The text as it may stand in a table."""
    return text.replace("|", r"\|").replace("<", "&lt;")


if __name__ == "__main__":
    sys.exit(main())
