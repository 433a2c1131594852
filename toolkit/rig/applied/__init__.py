"""What is put on an object before it is photographed: one file for each kind of booster, and the table of kinds."""
