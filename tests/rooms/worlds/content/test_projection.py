"""Projected paint lands where it was drawn."""

import numpy as np

from toolkit.rooms.worlds.content.drawing import Drawing, chart_points

RED = (255, 0, 0, 255)


def test_a_chart_knows_where_its_texels_lie_on_a_cylinder():
    angle, height = np.linspace(0, np.pi, 181), np.linspace(0, 30, 4)
    net = np.stack(np.broadcast_arrays(10 * np.cos(angle), 10 * np.sin(angle), height[:, None]), axis=-1)
    points, normals = chart_points(net, 90, 60)
    turned = np.pi * (np.arange(90) + 0.5) / 90
    np.testing.assert_allclose(points[..., 0], np.tile(10 * np.cos(turned), (60, 1)), atol=0.02)
    np.testing.assert_allclose(points[:, 0, 2], 30 * (1 - (np.arange(60) + 0.5) / 60), atol=0.02)
    np.testing.assert_allclose(normals[..., :2], points[..., :2] / 10, atol=0.02)


def test_a_mark_is_found_at_its_millimetres_and_nowhere_else():
    sheet = Drawing((-1, 0, 0), (0, 0, 1), (-20, -10), (20, 10))  # seen from the left: the front is on the left
    sheet.disc((-8, 3), 2, RED)
    side = sheet.side()
    np.testing.assert_allclose(side.towards, [0, 1, 0])
    points = np.array([[[8, 55, 3], [9.8, 0, 3], [10.3, 0, 3], [-8, 0, 3], [8, 0, -3], [100, 0, 3]]], np.float32)
    marks = side.sample(points)[0]
    np.testing.assert_allclose(marks[:2], [RED, RED], atol=1)
    assert not marks[2:].any()


def test_a_half_covered_texel_is_half_as_strong():
    sheet = Drawing((1, 0, 0), (0, 1, 0), (0, 0), (10, 10))
    sheet.fill([(0, 0), (5, 0), (5, 10), (0, 10)], RED)
    edge = sheet.side().sample(np.array([[[5, 5, 0]]], np.float32))[0, 0]
    assert 60 < edge[3] < 195
    np.testing.assert_allclose(edge, [edge[3], 0, 0, edge[3]], atol=1)
