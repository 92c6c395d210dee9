"""A session's recording: one MCAP file beside its trail, written, read, checked and handed on."""
