"""From a phone to `captures/real`: lens, board pose, import, checks, print profile."""
