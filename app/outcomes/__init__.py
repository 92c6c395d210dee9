"""Outcome measures of a session: steps, distance, times, symmetry, ranges of motion."""
