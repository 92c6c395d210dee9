"""From one image (and a depth map) to gesture, distance and press: pure stages and their pipeline."""
