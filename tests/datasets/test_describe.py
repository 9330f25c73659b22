from pathlib import Path

from actorsnerf_datasets.describe import describe
from actorsnerf_datasets.reader import SequenceFile


def test_the_screen(sequence_path: Path) -> None:
    sequence = SequenceFile(sequence_path)
    text = describe(sequence)
    lines = text.splitlines()
    assert lines[0].startswith(f"{sequence_path} (0.")
    assert "actor       anna, sequence dance-01" in lines
    assert "source      synthetic: test; terms: free" in lines
    assert "body        points, 240 vertices, 1.75 m at rest" in lines
    assert "frames      12: 100 to 111, every 1" in lines
    assert "35 crops of 48 x 64 at scale 0.5, 35 usable, of 36 camera-frame pairs" in text
    assert "            c03: 80 x 80, f 60 px, 3.0 m away, 11 usable pictures" in lines
    assert "protocol    generic: held_out, training camera c01, uses 16 pictures" in lines
    assert "            evaluation on 5 frames 107 to 111, 2 cameras" in lines
    assert "fewshot-5 (official): 5 frames 100 to 106, support 100, 103, 106" in text
    assert "note        another: über" in lines
    assert lines[-1] == f"digest      {sequence.digest}"
    assert len(lines) < 40
    assert max(map(len, lines[1:])) < 120
