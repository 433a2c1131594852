"""From a phone to `captures/real`: lens, board, import, checks, print profile."""
