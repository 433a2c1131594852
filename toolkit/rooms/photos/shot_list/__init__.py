"""The list to take to the table: how to stick the patch, then every camera place with what it should see."""
