"""Cameras: one small Protocol (`camera.py`), one factory (`factory.py`), drivers that pass one contract suite."""
