"""What happened, provably: audit records, hash chain, writer, verifier, review."""
