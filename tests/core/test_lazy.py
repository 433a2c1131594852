from toolkit.core.child import run_python


def test_library_loads_when_a_name_of_it_is_used() -> None:
    code = (
        "import sys; from toolkit.core.lazy import cv2, np, shapely, torch; "
        "loaded = [name for name in ('cv2', 'numpy', 'shapely', 'torch') if name in sys.modules]; "
        "print(loaded, shapely.Point(1, 2).x, 'shapely' in sys.modules, 'torch' in sys.modules)"
    )
    assert run_python(code).stdout.split() == [b"[]", b"1.0", b"True", b"False"]


def test_names_are_those_of_the_library() -> None:
    import numpy

    from toolkit.core.lazy import np

    assert np.ndarray is numpy.ndarray and isinstance(numpy.zeros(1), np.ndarray)
