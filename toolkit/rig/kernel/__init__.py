"""From first hits to colour, in machine code: textures, stored light, gloss, table, room, edges, development."""
