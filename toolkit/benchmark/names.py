"""What a class's files are called in a patch set."""

from collections.abc import Sequence

from toolkit.boosters.request import name_files


def name_class(labels: Sequence[str], index: int) -> str:
    """File name without suffix: from the label, with the index where another class's would be the same."""
    names = [name_files(None, label, k) for k, label in enumerate(labels)]
    # file systems that know no case, and ImageNet's two 'crane'
    same = [k for k, name in enumerate(names) if name.lower() == names[index].lower()]
    return names[index] if len(same) == 1 else f"{names[index]}_{index}"
