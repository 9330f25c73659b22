"""From raw data sets to prepared files: read `source` and `prepare` first."""
