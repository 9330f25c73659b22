"""Hard cases: what they are, how they are tried at three precisions, and their table."""
