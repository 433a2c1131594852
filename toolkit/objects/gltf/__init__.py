"""glTF 2.0: a file's parts as triangles, texture coordinates and materials; what is left out is listed."""
