"""From where and in what light: camera, poses, studio, renderers, patch mounting."""
