"""What a face of a world is: the classes of the segmentation."""

from enum import IntEnum


class SceneClass(IntEnum):
    """Class of a face; 0 is what no world names."""

    OTHER = 0
    GROUND = 1
    ROAD = 2
    PAVEMENT = 3
    GRASS = 4
    WATER = 5
    BUILDING = 6
    ROOF = 7
    VEHICLE = 8
    TREE = 9
    FURNITURE = 10
    SIGN = 11
    PAD = 12
    SKYLINE = 13


STANDING = (SceneClass.GROUND, SceneClass.ROAD, SceneClass.PAVEMENT, SceneClass.GRASS, SceneClass.WATER)
"""Classes of the ground: what lies under everything else."""
