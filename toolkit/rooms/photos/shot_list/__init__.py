"""The printed shot list: how to stick the patch, then every camera place with its picture."""
