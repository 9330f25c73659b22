from dataclasses import replace
from pathlib import Path

from actorsnerf_preprocess.run_report import (
    CHECK_NOTICE,
    CameraReport,
    Report,
    finding_lines,
    finished_settings,
    report_lines,
    unusable_pictures,
    write_report,
)
from actorsnerf_preprocess.source import Finding

REPORT = Report(
    sequence="CoreView_377",
    file="out/CoreView_377.h5",
    settings="abc",
    stored=98,
    asked=100,
    crop_size=(208, 400),
    bytes=4_900_000,
    seconds=7.0,
    cameras=(CameraReport("B1", 50, 50, 0.99), CameraReport("B2", 48, 50, 0.55)),
    unusable=unusable_pictures([("missing", "x.jpg"), ("empty mask", "y.png")]),
    stray=3,
    touching=0,
    findings=(),
    notes=("Translations are metres.",),
)


def test_the_screen_says_what_was_stored_and_what_was_not() -> None:
    lines = "\n".join(report_lines(REPORT))
    assert "98 of 100 pictures stored in out/CoreView_377.h5" in lines
    assert "208 x 400, 4.9 MB, 7.0 s, 14.0 pictures/s" in lines
    assert "not stored: 1 x missing, for example x.jpg" in lines
    assert "B2: only 55 % of the projected body lies inside the mask" in lines
    assert "B1: only" not in lines
    assert "3 masks have parts away from the body" in lines
    assert "inside the mask: 77.0 %" in lines
    assert "note: Translations are metres." in lines


def test_made_masks_have_no_share() -> None:
    cameras = (CameraReport("c01", 50, 50, None),)
    assert "inside the mask" not in "\n".join(report_lines(replace(REPORT, cameras=cameras)))


def test_findings_are_sorted_by_gravity() -> None:
    findings = [
        Finding("note", "a", "A."),
        Finding("error", "b", "B."),
        Finding("warning", "c", "C."),
    ]
    assert finding_lines(findings) == ["  error: b: B.", "  warning: c: C.", "  note: a: A."]


def test_a_report_is_read_back_by_its_settings(tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    assert finished_settings(path) == ""
    write_report(path, REPORT)
    assert finished_settings(path) == "abc"
    assert CHECK_NOTICE in path.read_text()
    path.write_text("{ cut off")
    assert finished_settings(path) == ""
    path.write_text("[]")
    assert finished_settings(path) == ""
