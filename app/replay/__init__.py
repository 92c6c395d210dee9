"""`rleex audit replay`: decisions made again from a trail's recorded inputs, and compared with the recorded ones."""
