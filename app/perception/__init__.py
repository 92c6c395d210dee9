"""The camera, the hand pipeline, the picture for the screen: a process of its own."""
