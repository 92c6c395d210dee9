"""Patients: the list, the form with live checks, the drawing of the step, the history."""
