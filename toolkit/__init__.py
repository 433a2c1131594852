"""Boost physical objects for a neural network, and prove that it worked.

The road from object to report is the list of sub-packages: `objects` and `boosters` say what is photographed and what
is added to it, `rig` and `printing` put the two together in simulation and on paper, `captures` keeps the images, and
`classifiers` and `evaluation` turn them into a table that can be trusted.
"""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("toolkit-boost")
except PackageNotFoundError:  # run from a source tree that was never installed
    __version__ = "0.0.0"
