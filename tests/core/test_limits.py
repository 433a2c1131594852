"""How much memory a part of this process may take."""

import sys

import pytest

from toolkit.core.limits import limit_memory

MB = 1 << 20


@pytest.mark.skipif(sys.platform != "linux", reason="memory is bounded on Linux alone")
def test_of_two_bounds_the_lower_counts_until_it_ends():
    with limit_memory(512 * MB):
        with limit_memory(64 * MB), pytest.raises(MemoryError):
            bytearray(128 * MB)
        assert len(bytearray(128 * MB)) == 128 * MB
        with pytest.raises(MemoryError):
            bytearray(1024 * MB)
    assert len(bytearray(1024 * MB)) == 1024 * MB
