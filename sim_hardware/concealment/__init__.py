"""Drawing, recording and sealing benches that hide an effect."""
