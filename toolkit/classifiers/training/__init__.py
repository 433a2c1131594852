"""Training a classifier from renders or from a folder of images.

Stands above its parent package: it draws on the rig, on captures and on boosters, which the rest of
`toolkit.classifiers` may not.
"""
