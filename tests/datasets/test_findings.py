import pytest

from actorsnerf_datasets.findings import Finding, listed


def test_a_few_numbers_are_all_listed() -> None:
    assert listed([]) == ""
    assert listed([1, 2, 3, 4, 5]) == "1, 2, 3, 4, 5"
    assert listed([1, 2, 3, 4, 5, 6]) == "1, 2, 3, 4, 5, … (6 in all)"


def test_a_finding_cannot_be_changed() -> None:
    finding = Finding("note", "fits", "fine")
    with pytest.raises(AttributeError, match="severity"):
        finding.severity = "error"  # type: ignore[misc]
