"""Files read strictly and written whole."""
