"""Joints: one small Protocol (`joints.py`), the guard before it, one factory, drivers that pass one contract suite."""
