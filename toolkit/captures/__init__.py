"""A folder of images and what is known of each."""
