"""Measurements a reader can repeat: every figure in the documents comes from here."""
