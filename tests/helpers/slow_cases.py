"""Tests of which some cases alone take long."""

from collections.abc import Iterable
from typing import Any

import pytest


def mark_slow(cases: Iterable[Any], *slow: object) -> list[Any]:
    """The cases for `parametrize`; those in `slow`, beside which cheaper ones try the same, are left to `test-all`."""
    return [pytest.param(one, marks=pytest.mark.slow) if one in slow else one for one in cases]
