"""Lists of idempotent work units, addressed by the hash of their inputs: here, in a pool of processes, or on Ray."""
