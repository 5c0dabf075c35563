"""How time and memory grow with what there is to be learned, and with who learns it."""
