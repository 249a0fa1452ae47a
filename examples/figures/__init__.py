"""Measured figures that the pages quote, a CSV file each; `examples.pages` writes and reads them."""
