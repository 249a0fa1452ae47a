"""Both kinds of FMU in every importer on a machine."""
