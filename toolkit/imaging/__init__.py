"""Pictures as arrays: reading what people have, colour, resize and crop."""
