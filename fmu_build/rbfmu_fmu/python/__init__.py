"""The kind of FMU that uses pythonfmu: the importer's process needs Python."""
