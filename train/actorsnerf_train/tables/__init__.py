"""The paper's tables from results, and the runs that fill them: read `command` first."""
