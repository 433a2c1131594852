"""What patches are compared with: codes, photographs and fixed patterns in their place (the paper, Appendix D.2)."""
