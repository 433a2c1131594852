"""`toolkit studio`: a local web page to photograph with, over the same functions as the command line."""
