"""Everything that touches hardware or stands in for it: cameras and joints, each a Protocol, a factory and drivers."""
