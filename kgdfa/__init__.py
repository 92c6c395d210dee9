"""From one image (and, if there, its depth map) to what the hand says: pure stages and their pipeline."""
