"""The camera, the hand pipeline, the image for the screen: a process of its own."""
