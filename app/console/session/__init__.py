"""The live session screen, one file a widget."""
