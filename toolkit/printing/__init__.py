"""From booster to page, in millimetres."""
