"""From logs to findings, joint by joint, and how they are told."""
