"""Networks, their weights, labels and preprocessing."""

from toolkit.models.load import load_classifier
from toolkit.models.network import Classifier

__all__ = ["Classifier", "load_classifier"]
