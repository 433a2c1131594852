"""Networks, their weights and their preprocessing."""

from toolkit.classifiers.network import Classifier, load_classifier

__all__ = ["Classifier", "load_classifier"]
