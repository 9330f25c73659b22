"""Trainings, evaluation and pictures: read `loop` first."""
