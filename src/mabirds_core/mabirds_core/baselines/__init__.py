"""Central methods that MA-BIRDS is compared with: one place sees all demonstrations."""
